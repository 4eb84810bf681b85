// nadird --check as it is called before take-off: what the aircraft remembers, permits to go back, damage.
#include <gmock/gmock.h>

#include <algorithm>
#include <chrono>
#include <map>
#include <new>
#include <nlohmann/json.hpp>
#include <thread>

#include "base/files.hpp"
#include "cli/terminal.hpp"
#include "imagery/codecs.hpp"
#include "nadird_fixture.hpp"
#include "trust/installed_report.hpp"
#include "trust/signatures.hpp"

namespace nadir {
namespace {

using nlohmann::json;

// The moment that it is asked for is the one at which somebody ends the service.
class LastMoment final : public Clock {
 public:
  UtcTime now() const override {
    ::kill(::getpid(), SIGTERM);
    while (!interrupt_requested()) std::this_thread::yield();
    return test::kJudged;
  }
};

// The thread that made it has no memory left as soon as it waits for something.
class NoMemoryInFlight final : public FlightClock {
 public:
  double monotonic_s() const override { return still_.monotonic_s(); }
  std::int64_t unix_us() const override { return still_.unix_us(); }
  const std::string& boot_id() const override { return still_.boot_id(); }
  bool wait_until(double until_s, std::stop_token stop) const override {
    if (std::this_thread::get_id() == maker_) throw std::bad_alloc();
    return still_.wait_until(until_s, std::move(stop));
  }

 private:
  ManualClock still_;
  std::thread::id maker_ = std::this_thread::get_id();
};

class NadirdCheck : public test::NadirdFixture {
 protected:
  NadirdCheck() : older_(make_package("older", 3)), newer_(make_package("newer", 4)) {}
  int check(const std::string& package, std::initializer_list<std::string> more = {}) {
    std::vector<std::string> args{"--package",        package,   "--trust", path("root.json"), "--state",
                                  path("state.json"), "--check", "--json"};
    args.insert(args.end(), more);
    return run(args, clock_);
  }
  void permit(const std::string& name, std::int64_t from, std::int64_t to) {
    const UtcTime expires{test::kJudged.unix_s + 86'400};
    folder_.write(name, sign_permit({"village", from, to, std::nullopt, expires}, {&maker_.signer}).document.json());
  }
  void airframe(const std::string& name, const PrivateKey* key,
                const std::string& dates = R"("sequence": 3, "expires": "2024-06-01", )") {
    const std::string text = airframe_json(dates);
    folder_.write(name, text);
    if (key == nullptr) return;
    const Envelope envelope{std::string(kAirframePayloadType),
                            {sign_payload(*key, kAirframePayloadType, as_bytes(text))}};
    folder_.write(name + ".sig", envelope_json(envelope));
  }
  int serve(const Clock& clock, const FlightClock* flight_clock, std::initializer_list<std::string> more = {}) {
    airframe("bare.json", nullptr);
    return run_service(service_options(newer_, "bare.json", "none"), more, clock, flight_clock);
  }
  // A root that gives tile keys to airframes, and takes some back.
  void name_tile_signers(const std::map<std::string, const PrivateKey*>& keys, std::optional<UtcTime> expires,
                         const PrivateKey* revoked) {
    TrustRoot root = maker_.root;
    for (const auto& [airframe, key] : keys) {
      const std::string id = key->public_key().id();
      root.keys.emplace(id, TrustedKey{key->public_key(), expires});
      root.tile_signers[airframe] = Role{{id}, 1};
    }
    if (revoked != nullptr) root.revoked.insert(revoked->public_key().id());
    folder_.write("root.json", sign_root(root, {&maker_.signer}).json());
  }
  int check_tiles(const PrivateKey& key) {
    write_file_atomic(folder_ / "tile.pem", key.pem(), 0600);
    return check(newer_, {"--airframe", "mini-07", "--candidates", path("tiles"), "--tile-key", path("tile.pem")});
  }
  // A root that says who provisions aircraft.
  void name_airframe_signer(const PrivateKey& key) {
    TrustRoot root = maker_.root;
    root.add_key(key.public_key());
    root.airframe_signer = Role{{key.public_key().id()}, 1};
    folder_.write("root.json", sign_root(root, {&maker_.signer}).json());
  }
  bool has_code(const std::string& code) const {
    const json findings = json::parse(out_.str())["findings"];
    return std::any_of(findings.begin(), findings.end(), [&](const json& finding) { return finding["code"] == code; });
  }
  std::string first_code() const { return json::parse(out_.str())["findings"][0]["code"]; }

  FixedClock clock_{test::kJudged};
  std::string older_, newer_;
};

// Before take-off a missing camera and a silent autopilot are errors, not "not checked".
TEST_F(NadirdCheck, LooksAtTheCamera) {
  airframe("bare.json", nullptr);
  std::filesystem::create_directories(folder_ / "frames");
  const auto frame = [&](int width, int height) {
    folder_.write("frames/.frame.png",
                  as_text(encode_image(cv::Mat(height, width, CV_8UC1, cv::Scalar(90)), ImageFormat::png)));
    std::filesystem::rename(folder_ / "frames/.frame.png", folder_ / "frames/frame.png");
  };
  const auto check_with = [&](int width, int height) {
    const std::jthread camera([&](const std::stop_token& stop) {
      while (!stop.stop_requested()) {
        frame(width, height);
        std::this_thread::sleep_for(std::chrono::milliseconds(20));
      }
    });
    return check(newer_, {"--airframe", path("bare.json"), "--camera", "folder:" + path("frames")});
  };
  EXPECT_EQ(check_with(640, 480), 0) << out_.str() << err_.str();
  EXPECT_THAT(std::string(json::parse(out_.str())["camera"]), testing::HasSubstr("frame.png, 640 x 480"));
  EXPECT_EQ(json::parse(out_.str())["autopilot"], "not checked: no --autopilot");
  EXPECT_EQ(check_with(320, 240), 1);
  EXPECT_TRUE(has_code("camera.size")) << out_.str();
}

// Whatever could fly, record or change a flight is no option of a recording.
TEST_F(NadirdCheck, PlaysWithoutAnythingThatFlies) {
  for (const std::vector<std::string>& more : std::vector<std::vector<std::string>>{{"--camera", "folder:frames"},
                                                                                    {"--autopilot", "udpin:0.0.0.0:1"},
                                                                                    {"--record", "again"},
                                                                                    {"--state", "state"},
                                                                                    {"--trust", "root.json"},
                                                                                    {"--candidates", "tiles"},
                                                                                    {"--start", "8.5,47.4"},
                                                                                    {"--unsigned-link"},
                                                                                    {"--check"}}) {
    std::vector<std::string> args{"--play", path("record")};
    args.insert(args.end(), more.begin(), more.end());
    EXPECT_EQ(run(args, clock_), 2) << more.front();
    EXPECT_THAT(err_.str(), testing::HasSubstr(more.front() + " cannot be given with --play"));
  }
  EXPECT_EQ(run({"--play", path("record")}, clock_), 2);
  EXPECT_THAT(err_.str(), testing::HasSubstr(path("record"))) << "there is none";
  EXPECT_EQ(run({"--session", "one"}, clock_), 2);
}

// A model that cannot be used is said, and keeps nobody on the ground.
TEST_F(NadirdCheck, LooksAtTheSecondMatcher) {
  airframe("bare.json", nullptr);
  EXPECT_EQ(check(newer_, {"--airframe", path("bare.json")}), 0) << out_.str() << err_.str();
  EXPECT_EQ(json::parse(out_.str())["second_matcher"], "none");
  const std::string digest(64, '7');
  airframe("second.json", nullptr, R"("matcher": {"model": "none.onnx", "sha256": ")" + digest + R"("}, )");
  EXPECT_EQ(check(newer_, {"--airframe", path("second.json")}), 0) << out_.str() << err_.str();
  EXPECT_TRUE(has_code("matcher.unusable")) << out_.str();
  EXPECT_THAT(std::string(json::parse(out_.str())["second_matcher"]), testing::HasSubstr("not used"));
  EXPECT_EQ(check(newer_, {"--airframe", path("second.json"), "--second-matcher", "never"}), 0);
  EXPECT_FALSE(has_code("matcher.unusable")) << out_.str();
  folder_.write("none.onnx", "another one");
  EXPECT_EQ(check(newer_, {"--airframe", path("second.json")}), 0);
  EXPECT_THAT(out_.str(), testing::HasSubstr("not the one that was chosen"));
}

// Without parameters to compare, nobody will know whether the autopilot uses our position.
TEST_F(NadirdCheck, SaysWhetherParametersWillBeCompared) {
  const auto parameters = [&] { return std::string(json::parse(out_.str())["parameters"]); };
  airframe("bare.json", nullptr);
  EXPECT_EQ(check(newer_, {"--airframe", path("bare.json")}), 0) << out_.str() << err_.str();
  EXPECT_THAT(parameters(), testing::HasSubstr("the autopilot may not use our position"));
  airframe("provisioned.json", nullptr, R"("mavlink": {"parameters": [{"name": "GPS1_TYPE", "value": 14}]}, )");
  EXPECT_EQ(check(newer_, {"--airframe", path("provisioned.json")}), 0) << out_.str() << err_.str();
  EXPECT_THAT(parameters(), testing::HasSubstr("1 in the airframe file, compared"));
  EXPECT_EQ(check(newer_, {"--airframe", "mini-07"}), 0);
  EXPECT_EQ(parameters(), "not checked: no airframe file");
}

TEST_F(NadirdCheck, AnUnsignedLinkMustBeChosenForTheCheckToo) {
  EXPECT_EQ(check(newer_, {"--airframe", "mini-07", "--autopilot", "udpin:127.0.0.1:0"}), 2);
  EXPECT_NE(err_.str().find("--unsigned-link"), std::string::npos) << err_.str();
}

TEST_F(NadirdCheck, RejectsAnOlderPackage) {
  EXPECT_EQ(check(older_), 0) << out_.str() << err_.str();
  EXPECT_EQ(check(newer_), 0) << out_.str();
  EXPECT_TRUE(json::parse(out_.str())["ready"]);
  EXPECT_EQ(check(older_), 1);
  EXPECT_EQ(first_code(), "package.rollback");
}

TEST_F(NadirdCheck, APermitAllowsOneStepBack) {
  ASSERT_EQ(check(newer_), 0) << out_.str();
  permit("permit.json", 4, 3);
  permit("other.json", 5, 3);
  EXPECT_EQ(check(older_, {"--permit", path("other.json")}), 1);
  EXPECT_EQ(check(older_, {"--permit", path("permit.json")}), 0) << out_.str();
  EXPECT_EQ(check(older_), 1) << "the memory did not go down";
}

TEST_F(NadirdCheck, ADamagedPermitIsAFinding) {
  folder_.write("permit.json", "{\"signed\": {");
  EXPECT_EQ(check(newer_, {"--permit", path("permit.json")}), 1);
  EXPECT_EQ(first_code(), "permit.invalid");
  EXPECT_FALSE(std::filesystem::exists(path("state.json"))) << "nothing was accepted";
  EXPECT_EQ(check(newer_, {"--permit", path("none.json")}), 2);
}

TEST_F(NadirdCheck, ADamagedStateIsAFindingAndStaysAsItIs) {
  for (const std::string state : {"", "{\"schema\":", "[]", "\xff\xfe"}) {
    folder_.write("state.json", state);
    EXPECT_EQ(check(newer_), 1) << state;
    EXPECT_EQ(first_code(), "state.corrupt");
    EXPECT_EQ(read_text_file(folder_ / "state.json"), state);
  }
}

TEST_F(NadirdCheck, AnUnsignedAirframeIsReportedAndRejectedOnceTheRootNamesSigners) {
  airframe("bare.json", nullptr);
  EXPECT_EQ(check(newer_, {"--airframe", path("bare.json")}), 0) << out_.str() << err_.str();
  EXPECT_EQ(first_code(), "airframe.unsigned");
  name_airframe_signer(PrivateKey::generate());
  EXPECT_EQ(check(newer_, {"--airframe", path("bare.json")}), 1) << out_.str();
  EXPECT_EQ(first_code(), "airframe.unsigned");
  EXPECT_EQ(check(newer_, {"--airframe", path("bare.json"), "--unsigned-airframe"}), 0) << out_.str();
  EXPECT_EQ(first_code(), "airframe.unsigned") << "--check reports it";
  EXPECT_EQ(check(newer_, {"--airframe", "mini-07"}), 0) << "the id alone is no file";
}

TEST_F(NadirdCheck, AnAirframesSignatureIsVerified) {
  const PrivateKey hangar = PrivateKey::generate(), untrusted = PrivateKey::generate();
  name_airframe_signer(hangar);
  airframe("good.json", &hangar);
  EXPECT_EQ(check(newer_, {"--airframe", path("good.json")}), 0) << out_.str() << err_.str();
  EXPECT_TRUE(json::parse(out_.str())["findings"].empty());
  airframe("foreign.json", &untrusted);
  EXPECT_EQ(check(newer_, {"--airframe", path("foreign.json"), "--unsigned-airframe"}), 1);
  EXPECT_EQ(first_code(), "key.unknown");
  folder_.write("good.json", read_text_file(folder_ / "good.json") + " ");
  EXPECT_EQ(check(newer_, {"--airframe", path("good.json")}), 1);
  EXPECT_EQ(first_code(), "signature.invalid");
  airframe("good.json", &hangar);
  folder_.write("good.json.sig", std::string(100'000, ' '));
  EXPECT_EQ(check(newer_, {"--airframe", path("good.json")}), 1);
  EXPECT_EQ(first_code(), "signature.invalid");
}

TEST_F(NadirdCheck, AnEarlierAirframeFileIsARollback) {
  airframe("new.json", &maker_.signer);
  airframe("old.json", &maker_.signer, R"("sequence": 2, "expires": "2024-06-01", )");
  airframe("bare.json", &maker_.signer, "");
  EXPECT_EQ(check(newer_, {"--airframe", path("old.json")}), 0) << out_.str() << err_.str();
  EXPECT_EQ(check(newer_, {"--airframe", path("new.json")}), 0) << out_.str();
  EXPECT_TRUE(json::parse(out_.str())["findings"].empty());
  for (const char* earlier : {"old.json", "bare.json"}) {
    EXPECT_EQ(check(newer_, {"--airframe", path(earlier)}), 1) << earlier;
    EXPECT_EQ(first_code(), "airframe.rollback");
  }
  EXPECT_EQ(check(newer_, {"--airframe", path("new.json")}), 0) << "and at every later start";
}

// Anybody could claim the highest number in a file without a signature, and the aircraft would reject its own.
TEST_F(NadirdCheck, AnUnsignedAirframeFileIsNotRemembered) {
  airframe("claims.json", nullptr, R"("sequence": 999, "expires": "2024-06-01", )");
  EXPECT_EQ(check(newer_, {"--airframe", path("claims.json")}), 0) << out_.str() << err_.str();
  airframe("ours.json", &maker_.signer);
  EXPECT_EQ(check(newer_, {"--airframe", path("ours.json")}), 0) << out_.str();
  EXPECT_EQ(check(older_, {"--airframe", path("claims.json")}), 1) << "an older package";
  EXPECT_EQ(check(newer_, {"--airframe", path("ours.json")}), 0) << "what was rejected is not remembered either";
}

TEST_F(NadirdCheck, AnExpiredAirframeFileIsRejectedAndAnOlderFormGivesAWarning) {
  airframe("ours.json", &maker_.signer, R"("sequence": 3, "expires": "2024-04-25", )");
  EXPECT_EQ(check(newer_, {"--airframe", path("ours.json")}), 1) << out_.str();
  EXPECT_EQ(first_code(), "airframe.expired");
  airframe("ours.json", &maker_.signer, "");
  EXPECT_EQ(check(newer_, {"--airframe", path("ours.json")}), 0) << out_.str();
  EXPECT_EQ(first_code(), "airframe.undated");
}

TEST_F(NadirdCheck, AFailureInFlightDoesNotPreventARestart) {
  const NoMemoryInFlight clock;
  EXPECT_EQ(serve(clock_, &clock), 70);
  EXPECT_NE(err_.str().find("nadird failed: out of memory"), std::string::npos) << err_.str();
}

TEST_F(NadirdCheck, SigtermEndsTheServiceWhileThePackageIsVerified) {
  airframe("bare.json", nullptr);
  EXPECT_EQ(serve(LastMoment(), nullptr), 0) << "as asked";
  EXPECT_EQ(err_.str(), "stopped before the package was verified\n");
  EXPECT_FALSE(std::filesystem::exists(folder_ / "state" / "aircraft.json")) << "nothing was accepted";
  EXPECT_FALSE(interrupt_requested());
}

TEST_F(NadirdCheck, AnUnsignedLinkMustBeChosen) {
  airframe("bare.json", nullptr);
  EXPECT_EQ(run(service_options(newer_, "bare.json", "none"), clock_), 2);
  EXPECT_NE(err_.str().find("--unsigned-link"), std::string::npos) << err_.str();
  EXPECT_EQ(serve(clock_, nullptr, {"--signing-key", path("link.key")}), 2) << "both";
  EXPECT_EQ(serve(clock_, nullptr, {"--ground-station", "udpout:example.org:1"}), 2) << err_.str();
}

TEST_F(NadirdCheck, AnUntrustedTileKeyIsRejectedBeforeTakeOff) {
  const PrivateKey ours = PrivateKey::generate(), other = PrivateKey::generate(), untrusted = PrivateKey::generate();
  name_tile_signers({{"mini-07", &ours}, {"mini-08", &other}}, std::nullopt, nullptr);
  EXPECT_EQ(check_tiles(ours), 0) << out_.str() << err_.str();
  for (const auto& [key, found] : {std::pair{&untrusted, "not in the trust root"},
                                   {&other, "the tile key of airframe mini-08"},
                                   {&maker_.signer, "a package signer's"}}) {
    EXPECT_EQ(check_tiles(*key), 1) << found;
    EXPECT_EQ(first_code(), "key.unknown");
    EXPECT_NE(out_.str().find(found), std::string::npos) << out_.str();
  }
  name_tile_signers({{"mini-07", &ours}}, UtcTime{test::kJudged.unix_s + 1}, nullptr);
  EXPECT_EQ(check_tiles(ours), 0) << out_.str();
  name_tile_signers({{"mini-07", &ours}}, test::kJudged, nullptr);
  EXPECT_EQ(check_tiles(ours), 1);
  EXPECT_EQ(first_code(), "key.expired");
  name_tile_signers({{"mini-07", &ours}}, std::nullopt, &ours);
  EXPECT_EQ(check_tiles(ours), 1);
  EXPECT_EQ(first_code(), "key.revoked");
  folder_.write("tile.pem", "no key");
  EXPECT_EQ(check(newer_, {"--airframe", "mini-07", "--candidates", "c", "--tile-key", path("tile.pem")}), 2);
  write_file_atomic(folder_ / "tile.pem", ours.pem(), 0600);
  EXPECT_EQ(check(newer_, {"--candidates", "c", "--tile-key", path("tile.pem")}), 2) << "whose tiles?";
}

// A service may be started anew in flight, after the key was revoked: it goes without tiles rather than not at all.
TEST_F(NadirdCheck, InFlightAnUntrustedTileKeyDisablesOnlyTheTiles) {
  const PrivateKey ours = PrivateKey::generate();
  write_file_atomic(folder_ / "tile.pem", ours.pem(), 0600);
  for (const PrivateKey* revoked : {&ours, static_cast<const PrivateKey*>(nullptr)}) {
    name_tile_signers({{"mini-07", &ours}}, std::nullopt, revoked);
    const test::BriefFlight flight;
    EXPECT_EQ(serve(clock_, &flight, {"--candidates", path("tiles"), "--tile-key", path("tile.pem")}), 0) << err_.str();
    EXPECT_NE(err_.str().find("0 frames"), std::string::npos) << "it flew: " << err_.str();
    EXPECT_EQ(err_.str().find("key.revoked") != std::string::npos, revoked != nullptr) << err_.str();
    EXPECT_EQ(std::filesystem::exists(folder_ / "tiles"), revoked == nullptr);
  }
}

// The ground learns what it flies: signed by the tile key, and each time with a higher number.
TEST_F(NadirdCheck, WritesASignedReportOfItsPackage) {
  const PrivateKey ours = PrivateKey::generate();
  write_file_atomic(folder_ / "tile.pem", ours.pem(), 0600);
  name_tile_signers({{"mini-07", &ours}}, std::nullopt, nullptr);
  std::int64_t last = 0;
  for (const char* run : {"first", "second", "after its memory was damaged"}) {
    const test::BriefFlight flight;
    // --at: judged each time, and not resumed.
    EXPECT_EQ(serve(clock_, &flight,
                    {"--candidates", path("tiles"), "--tile-key", path("tile.pem"), "--at", to_rfc3339(clock_.now())}),
              0)
        << err_.str();
    const auto report = parse_installed_report(read_text_file(folder_ / "tiles" / kInstalledFile), run);
    EXPECT_EQ(report.report.airframe, "mini-07");
    EXPECT_EQ(report.report.package, sha256_file(std::filesystem::path(newer_) / kManifestFile));
    EXPECT_EQ(report.report.root_version, 1);
    EXPECT_TRUE(report.report.accepted);
    EXPECT_TRUE(std::find(report.report.findings.begin(), report.report.findings.end(), "airframe.unsigned") !=
                report.report.findings.end());
    const TrustRoot root = read_trusted_root(path("root.json"));
    EXPECT_FALSE(check_installed_signature(root, report, std::nullopt).findings.has_errors());
    const std::string_view which = run;
    if (which == "second") {
      EXPECT_EQ(report.report.number, last + 1);
      folder_.write("state/installed.json", std::string(100'000, 'x'));
    }
    last = report.report.number;
  }
}

}  // namespace
}  // namespace nadir
