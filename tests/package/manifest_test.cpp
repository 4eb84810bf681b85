#include "package/manifest.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <nlohmann/json.hpp>

#include "package/package_maker.hpp"

namespace nadir {
namespace {

using nlohmann::json;

Manifest sample() {
  Manifest manifest = manifest_for(*parse_mission(test::mission_yaml(), "m").mission);
  Artifact imagery;
  imagery.path = kImageryFile;
  imagery.role = kRoleImagery;
  imagery.size = 12345;
  imagery.tiles.emplace();
  imagery.tiles->count = 7;
  imagery.tiles->zoom = {17, 18};
  imagery.tiles->format = "jpeg";
  Artifact mission;
  mission.path = kMissionFile;
  mission.role = kRoleMission;
  mission.size = 99;
  manifest.artifacts = {mission, imagery};
  return manifest;
}

TEST(Manifest, RoundTrips) {
  const ManifestReading reading = parse_manifest(as_bytes(manifest_json(sample())));
  ASSERT_TRUE(reading.manifest) << test::codes(reading.findings);
  EXPECT_EQ(manifest_json(*reading.manifest), manifest_json(sample()));
  EXPECT_EQ(reading.manifest->artifact(kRoleImagery)->tiles->count, 7U);
  EXPECT_EQ(reading.manifest->artifact("none"), nullptr);
  EXPECT_EQ(reading.manifest->sequence, 3);
}

TEST(Manifest, VectorsStateTheirOriginAndLicence) {
  Manifest manifest = sample();
  Artifact vectors;
  vectors.path = kVectorsFile;
  vectors.role = kRoleVectors;
  vectors.vectors = VectorFacts{"© OpenStreetMap contributors", "ODbL-1.0", sha256(as_bytes("source")), 12, 3, 4, 567};
  manifest.artifacts.push_back(vectors);
  const ManifestReading reading = parse_manifest(as_bytes(manifest_json(manifest)));
  ASSERT_TRUE(reading.manifest) << test::codes(reading.findings);
  EXPECT_EQ(reading.manifest->artifact(kRoleVectors)->vectors, vectors.vectors);
  EXPECT_EQ(manifest_json(*reading.manifest), manifest_json(manifest));
  for (const auto& [member, value] : {std::pair<const char*, json>("attribution", std::string(201, 'x')),
                                      {"attribution", ""},
                                      {"licence", json()},
                                      {"source_sha256", "00"},
                                      {"roads", -1},
                                      {"surprise", 1}}) {
    json document = json::parse(manifest_json(manifest));
    document["artifacts"][2]["vectors"][member] = value;
    EXPECT_FALSE(parse_manifest(as_bytes(document.dump())).manifest) << member;
  }
}

TEST(Manifest, SourcesOfImageryStateTheirLicences) {
  Manifest manifest = sample();
  EXPECT_EQ(manifest_json(manifest).find("sources\""), std::string::npos) << "as of versions before";
  const auto imagery = std::find_if(manifest.artifacts.begin(), manifest.artifacts.end(),
                                    [](const Artifact& artifact) { return artifact.tiles.has_value(); });
  ASSERT_NE(imagery, manifest.artifacts.end());
  imagery->tiles->sources = {{"candidates", "unknown", ""}, {"survey", "CC-BY-4.0", "© survey 2024"}};
  const std::vector<SourceLicence> sources = imagery->tiles->sources;
  const ManifestReading reading = parse_manifest(as_bytes(manifest_json(manifest)));
  ASSERT_TRUE(reading.manifest) << test::codes(reading.findings);
  EXPECT_EQ(reading.manifest->artifact(kRoleImagery)->tiles->sources, sources);
  EXPECT_EQ(manifest_json(*reading.manifest), manifest_json(manifest));
  const json good = json::parse(manifest_json(manifest));
  const auto refused = [&](const std::function<void(json&)>& edit) {
    json document = good;
    for (json& artifact : document["artifacts"]) {
      if (artifact.contains("tiles")) edit(artifact["tiles"]["sources"]);
    }
    return !parse_manifest(as_bytes(document.dump())).manifest;
  };
  EXPECT_FALSE(refused([](json&) {}));
  EXPECT_TRUE(refused([](json& list) { list = json::array(); }));
  EXPECT_TRUE(refused([](json& list) { std::swap(list[0], list[1]); }));
  EXPECT_TRUE(refused([](json& list) { list[0].erase("licence"); }));
  EXPECT_TRUE(refused([](json& list) { list[0]["attribution"] = ""; }));
  EXPECT_TRUE(refused([](json& list) { list[0]["attribution"] = std::string(201, 'x'); }));
  EXPECT_TRUE(refused([](json& list) { list[1]["surprise"] = 1; }));
}

TEST(Manifest, BytesDoNotDependOnTheOrderOfArtifacts) {
  Manifest other = sample();
  std::swap(other.artifacts[0], other.artifacts[1]);
  EXPECT_EQ(manifest_json(other), manifest_json(sample()));
}

TEST(Manifest, BoundsContainTheMissionInWholeUnits) {
  const json document = json::parse(manifest_json(sample()));
  const auto bounds = document["bounds_e7"].get<std::vector<std::int64_t>>();
  EXPECT_LE(bounds[0], 109'990'000);
  EXPECT_LE(bounds[1], 479'990'000);
  EXPECT_GE(bounds[2], 110'040'000 + 5000);  // the route's end and most of 40 m
  EXPECT_GE(bounds[3], 480'010'000 - 1);
  EXPECT_LT(bounds[2], 110'050'000);
}

TEST(Manifest, ContainsNoFloats) { EXPECT_EQ(manifest_json(sample()).find('.' + std::string("0")), std::string::npos); }

class ManifestRefusal : public ::testing::Test {
 protected:
  void expect(const std::string& text, const char* code) {
    const ManifestReading reading = parse_manifest(as_bytes(text));
    EXPECT_FALSE(reading.manifest) << text.substr(0, 300);
    EXPECT_TRUE(reading.findings.contains(code)) << test::codes(reading.findings);
  }
  void expect_schema(const std::function<void(json&)>& edit) {
    json document = json::parse(manifest_json(sample()));
    edit(document);
    expect(document.dump(), "manifest.schema");
  }
  void expect_path(const std::string& path) {
    Manifest manifest = sample();
    manifest.artifacts[0].path = path;
    expect(manifest_json(manifest), "manifest.path");
  }
};

TEST_F(ManifestRefusal, DuplicateKeys) {
  std::string text = manifest_json(sample());
  text.insert(text.find("\"created\""), "\"created\": \"2024-04-20T00:00:00Z\", ");
  expect(text, "manifest.schema");
}

TEST_F(ManifestRefusal, Floats) {
  std::string text = manifest_json(sample());
  text.replace(text.find("12345"), 5, "12345.0");
  expect(text, "manifest.schema");
  text.replace(text.find("12345.0"), 7, "1e4");
  expect(text, "manifest.schema");
}

TEST_F(ManifestRefusal, NumbersBeyondExactIntegers) {
  std::string text = manifest_json(sample());
  text.replace(text.find("12345"), 5, "9007199254740993");
  expect(text, "manifest.schema");
  text.replace(text.find("9007199254740993"), 16, "99999999999999999999999");
  expect(text, "manifest.schema");
  text.replace(text.find("99999999999999999999999"), 23, "-1");
  expect(text, "manifest.schema");
}

TEST_F(ManifestRefusal, DeepNesting) {
  expect(std::string(100'000, '[') + std::string(100'000, ']'), "manifest.schema");
  expect(std::string(500'000, '['), "manifest.schema");
}

TEST_F(ManifestRefusal, OversizedDocument) { expect(std::string((1 << 20) + 1, ' '), "manifest.schema"); }

TEST_F(ManifestRefusal, UnknownFieldsUnlessMarkedAsNotes) {
  expect_schema([](json& d) { d["must_understand"] = 1; });
  expect_schema([](json& d) { d["mission"]["airspace"] = "x"; });
  expect_schema([](json& d) { d["artifacts"][0]["tiles"]["extra"] = 1; });
  json document = json::parse(manifest_json(sample()));
  document["x-note"] = "built on a rainy day";
  document["artifacts"][0]["x-note"] = "the big one";
  EXPECT_TRUE(parse_manifest(as_bytes(document.dump())).manifest);
}

TEST_F(ManifestRefusal, MissingFields) {
  for (const char* name : {"schema", "mission", "created", "expires", "airframes", "bounds_e7", "artifacts"}) {
    expect_schema([name](json& d) { d.erase(name); });
  }
  for (const char* name : {"path", "role", "size", "sha256"}) {
    expect_schema([name](json& d) { d["artifacts"][0].erase(name); });
  }
}

TEST_F(ManifestRefusal, WrongTypes) {
  for (const char* name : {"schema", "mission", "created", "expires", "airframes", "bounds_e7", "artifacts"}) {
    for (const json& value : {json(), json(true), json(7), json("x"), json::array({1}), json::object({{"a", 1}})}) {
      expect_schema([&](json& d) { d[name] = value; });
    }
  }
  expect_schema([](json& d) { d["artifacts"][0]["sha256"] = std::string(64, 'G'); });
  expect_schema([](json& d) { d["artifacts"][0]["tiles"]["zoom_max"] = 99; });
  expect_schema([](json& d) { d["artifacts"][0]["tiles"]["zoom_min"] = 19; });
  expect_schema([](json& d) { d["artifacts"][0]["tiles"]["format"] = "gif"; });
  expect_schema([](json& d) { d["created"] = "2024-04-20T02:00:00+02:00"; });  // one spelling only
  expect_schema([](json& d) { d["bounds_e7"][0] = -1'800'000'001; });
}

TEST_F(ManifestRefusal, PathsOutOfThePackage) {
  for (const char* path : {"../x", "a/../x", "/etc/passwd", "a//b", "a/", "./a", "a/.", ".hidden", "a\\b", "C:x", "a b",
                           "a\nb", "\xC3\xA4", "..", "/"}) {
    expect_path(path);
  }
  expect_path(std::string(201, 'a'));
}

TEST_F(ManifestRefusal, PathsThatDifferInCaseOnly) {
  expect_path(std::string(kImageryFile));
  expect_path("Imagery/BASE.mbtiles");
  expect_path("manifest.json");
  expect_path("Manifest.sig");
}

TEST_F(ManifestRefusal, InvalidJson) {
  for (const char* text : {"", "{", "null", "[]", "{}", "\xFF\xFE", "{\"schema\":\"nadir.manifest/1\"} {}", "//\n{}"}) {
    expect(text, "manifest.schema");
  }
}

TEST(PackagePath, AcceptsValidNames) {
  for (const char* path : {"a", "imagery/base.mbtiles", "root/2.root.json", "a-b_c.D/e..f"}) {
    EXPECT_FALSE(path_problem(path)) << path;
  }
}

}  // namespace
}  // namespace nadir
