// The JSON Schemas of schemas/ against what the programs write. python3-jsonschema is the judge.
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "base/files.hpp"
#include "commands/command_fixture.hpp"
#include "package/mission.hpp"
#include "package/package_maker.hpp"
#include "package_delta/package_patch.hpp"
#include "provision/airframe_manifest.hpp"
#include "support/process.hpp"

namespace nadir {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;

class Schemas : public test::CommandTest {
 protected:
  void SetUp() override {
    if (test::run_shell("python3 -c 'import jsonschema; jsonschema.Draft202012Validator'").code != 0) {
      GTEST_SKIP() << "NOT TESTED: python3-jsonschema is not installed";
    }
    const TrustRoot& first = maker_.root;
    folder_.write("root.json", sign_root(first, {&maker_.signer}).json());
    write_file_atomic(folder_ / "p.key.pem", maker_.signer.pem(), 0600);
    TrustRoot second = first;
    second.version = 2;
    second.tile_signers["mini-07"] = second.package_signer;
    second.airframe_signer = second.package_signer;
    second.revoked = {std::string(64, 'a')};
    second.keys.begin()->second.expires = second.expires;
    folder_.write("2.json", sign_root(second, {&maker_.signer}).json());
    package_ = maker_.make(folder_);
    ASSERT_EQ(run({"cache", "sign", package_.string(), "--key", path("p.key.pem"), "--carry-root", path("2.json")}), 0)
        << err_.str();
  }

  // True when the schema takes the document.
  bool takes(const std::string& schema, const json& document) {
    folder_.write("document.json", document.dump());
    return test::run_process({"python3", "-c",
                              "import json, sys, jsonschema\n"
                              "schema = json.load(open(sys.argv[1]))\n"
                              "jsonschema.Draft202012Validator.check_schema(schema)\n"
                              "sys.exit(0 if jsonschema.Draft202012Validator(schema).is_valid("
                              "json.load(open(sys.argv[2]))) else 1)",
                              std::string(NADIR_SCHEMAS) + "/" + schema + ".schema.json", path("document.json")})
               .code == 0;
  }
  json read(const fs::path& file) const { return json::parse(read_text_file(file)); }

  fs::path package_;
};

TEST_F(Schemas, PackagePatch) {
  maker_.mission = test::mission_yaml({{"sequence: 3", "sequence: 4"}});
  maker_.make(folder_, "next");
  ASSERT_EQ(run({"cache", "diff", package_.string(), "@next", "--patch", "@patch", "--key", "@p.key.pem"}), 0)
      << err_.str();
  json patch = json::parse(read_patch(InputFile(folder_ / "patch")).document.json());
  EXPECT_TRUE(takes("package-patch", patch));
  patch["signed"]["files"][0].erase("sha256");
  EXPECT_FALSE(takes("package-patch", patch));
}

TEST_F(Schemas, Root) {
  for (const char* name : {"root.json", "2.json"}) EXPECT_TRUE(takes("root", read(folder_ / name))) << name;
  json wrong = read(folder_ / "2.json");
  wrong["signed"]["version"] = 0;
  EXPECT_FALSE(takes("root", wrong));
  wrong = read(folder_ / "2.json");
  wrong["signed"]["roles"].erase("package-signer");
  EXPECT_FALSE(takes("root", wrong));
}

// JSON is YAML: the schema and the reader judge the same documents.
TEST_F(Schemas, MissionWithAndWithoutIntegrity) {
  const auto agree = [&](const json& integrity) -> std::optional<bool> {
    json mission = json::parse(R"({"schema": "nadir.mission/1", "id": "a", "series": "a", "sequence": 1,
      "created": "2024-04-20", "expires": "2024-06-01", "takeoff": {"lon_deg": 11, "lat_deg": 48},
      "terrain": {"mode": "flat"}, "zoom": {"min": 17, "max": 18}, "min_resolution_m": 0.5, "budget_mb": 20,
      "freshness_days": {"stable": 730, "active": 90}, "airframes": ["any"], "sectors": [],
      "route": {"corridor_half_width_m": 40, "agl_m": 120, "points": [[11, 48], [11.004, 48.0005]]}})");
    if (!integrity.is_null()) mission["integrity"] = integrity;
    const bool by_schema = takes("mission", mission);
    const bool by_reader = parse_mission(mission.dump(), "mission.json").mission.has_value();
    return by_schema == by_reader ? std::optional(by_reader) : std::nullopt;
  };
  for (const char* good :
       {"null", "{}", R"({"risk": 1e-7})", R"({"risk": 1e-9, "alert_limit_m": 1, "time_to_alert_s": 0.5})",
        R"({"risk": 0.01, "alert_limit_m": 10000, "time_to_alert_s": 60})"}) {
    EXPECT_EQ(agree(json::parse(good)), true) << good;
  }
  for (const char* bad : {"[]", R"({"risk": 0})", R"({"risk": 0.02})", R"({"risk": "low"})", R"({"alert_limit_m": 0})",
                          R"({"alert_limit_m": 10001})", R"({"time_to_alert_s": 0})", R"({"time_to_alert_s": 61})",
                          R"({"limit_m": 5})"}) {
    EXPECT_EQ(agree(json::parse(bad)), false) << bad;
  }
}

TEST_F(Schemas, RollbackPermit) {
  for (const bool one : {false, true}) {
    std::vector<std::string> args{
        "keys", "permit-rollback", "--key",     path("p.key.pem"), "--series", "village", "--from", "4", "--to",
        "3",    "--expires",       "2024-05-01"};
    if (one) args.insert(args.end(), {"--airframe", "mini-07"});
    args.insert(args.end(), {"--out", path(one ? "one.json" : "all.json")});
    ASSERT_EQ(run(args), 0) << err_.str();
    json permit = read(folder_ / (one ? "one.json" : "all.json"));
    EXPECT_TRUE(takes("rollback-permit", permit));
    permit["signed"].erase("to");
    EXPECT_FALSE(takes("rollback-permit", permit));
  }
}

TEST_F(Schemas, TimePermit) {
  ASSERT_EQ(run({"keys", "permit-time", "--key", path("p.key.pem"), "--remembered", "2027-03-01", "--instead",
                 "2024-05-01", "--airframe", "mini-07", "--expires", "2025-05-01", "--out", path("time.json")}),
            0)
      << err_.str();
  json permit = read(folder_ / "time.json");
  EXPECT_TRUE(takes("time-permit", permit));
  permit["signed"].erase("instead");
  EXPECT_FALSE(takes("time-permit", permit));
  EXPECT_EQ(run({"keys", "permit-time", "--key", path("p.key.pem"), "--remembered", "2024-03-01", "--instead",
                 "2024-05-01", "--expires", "2025-05-01", "--out", path("forwards.json")}),
            2);
}

TEST_F(Schemas, Airframe) {
  Airframe airframe;
  airframe.id = "falcon-7";
  airframe.camera.camera = {
      .width = 640, .height = 480, .fx = 500, .fy = 500, .cx = 319.5, .cy = 239.5, .distortion = {}};
  airframe.sequence = 3;
  airframe.expires = UtcTime{1'893'456'000};
  json document = json::parse(airframe_json(airframe));
  EXPECT_TRUE(takes("airframe", document)) << document;
  EXPECT_EQ(document["expires"], "2030-01-01T00:00:00Z");
  const Airframe back = parse_airframe(document.dump(), "test");
  EXPECT_EQ(back.sequence, airframe.sequence);
  EXPECT_EQ(back.expires, airframe.expires);
  airframe.camera.readout = SensorReadout{0.024, SensorReadout::Direction::up};
  airframe.camera.on_gimbal = true;
  EXPECT_THROW(parse_airframe(airframe_json(airframe), "test"), UsageError) << "on no gimbal that is known";
  airframe.gimbal = GimbalAddress{1, 2};
  const json carried = json::parse(airframe_json(airframe));
  EXPECT_TRUE(takes("airframe", carried)) << carried;
  const Airframe moving = parse_airframe(carried.dump(), "test");
  ASSERT_TRUE(moving.gimbal && moving.camera.readout);
  EXPECT_EQ(moving.gimbal->component, 1);
  EXPECT_EQ(moving.gimbal->device, 2);
  EXPECT_DOUBLE_EQ(moving.camera.readout->duration_s, 0.024);
  EXPECT_EQ(moving.camera.readout->direction, SensorReadout::Direction::up);
  document.erase("sequence");
  document.erase("expires");
  EXPECT_TRUE(takes("airframe", document)) << "of before they existed";
  document["sequence"] = 0;
  EXPECT_FALSE(takes("airframe", document));
}

TEST_F(Schemas, ManifestStateAndReport) {
  EXPECT_TRUE(takes("manifest", read(package_ / kManifestFile)));
  std::vector<std::string> verify{"cache",           "verify",  package_.string(),  "--trust",
                                  path("root.json"), "--state", path("state.json"), "--json"};
  ASSERT_EQ(run(verify), 0) << out_.str();
  json report = json::parse(out_.str());
  EXPECT_TRUE(takes("verify-report", report)) << report;
  json state = read(folder_ / "state.json");
  EXPECT_TRUE(state.contains("roots"));
  EXPECT_TRUE(takes("state", state)) << state;
  state["airframes"] = {{"mini-07", 3}};
  EXPECT_TRUE(takes("state", state)) << state;
  EXPECT_TRUE(takes("root", state["roots"]["2"]));
  state["series"]["village"] = "3";
  EXPECT_FALSE(takes("state", state));
  report.erase("sequence");
  EXPECT_FALSE(takes("verify-report", report));
  // Refused, before and after the signature has passed.
  folder_.write("package/extra", "x");
  EXPECT_EQ(run(verify), 1);
  EXPECT_TRUE(takes("verify-report", json::parse(out_.str()))) << out_.str();
  fs::remove(package_ / kSignatureFile);
  EXPECT_EQ(run(verify), 1);
  EXPECT_TRUE(takes("verify-report", json::parse(out_.str()))) << out_.str();
}

}  // namespace
}  // namespace nadir
