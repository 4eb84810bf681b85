// nadir cache matchability as a user calls it, and its layer in the report of cache verify.
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "base/files.hpp"
#include "commands/command_fixture.hpp"
#include "package/open_package.hpp"
#include "package/package_maker.hpp"
#include "package/vector_layer.hpp"
#include "package_build/matchability_survey.hpp"
#include "support/process.hpp"

namespace nadir {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;

class CacheMatchability : public test::CommandTest {};

TEST_F(CacheMatchability, FiguresJsonAndGeoTiffAgree) {
  const std::string package = maker_.make(folder_).string();
  ASSERT_EQ(run({"cache", "matchability", package, "--footprint-m", "60", "--search-m", "60", "--step-m", "80",
                 "--speed-mps", "20", "--out", path("m.tif"), "--json"}),
            0)
      << err_.str();
  const json result = json::parse(out_.str());
  const double good = result["share"]["good"], weak = result["share"]["weak"], poor = result["share"]["poor"];
  EXPECT_NEAR(good + weak + poor, 1, 1e-3);
  EXPECT_NEAR(result["route_m"].get<double>(), 303.5, 1) << "of the mission's route";
  const auto info = test::run_process({"gdalinfo", "-json", "-stats", path("m.tif")});
  ASSERT_EQ(info.code, 0) << info.err;
  const double share =
      std::stod(json::parse(info.out)["bands"][3]["metadata"][""]["STATISTICS_VALID_PERCENT"].get<std::string>());
  const json size = json::parse(info.out)["size"];
  EXPECT_NEAR(share / 100 * size[0].get<double>() * size[1].get<double>(), result["places"].get<double>(), 0.3);
  for (const json& stretch : result["without_good"]) {
    EXPECT_NEAR(stretch["seconds"].get<double>() * 20, stretch["length_m"].get<double>(), 2);
  }
  ASSERT_EQ(run({"cache", "matchability", package, "--footprint-m", "60", "--search-m", "60", "--step-m", "80"}), 0);
  EXPECT_NE(out_.str().find("longest segment without a good place"), std::string::npos);
}

TEST_F(CacheMatchability, WaterOfThePackagesVectorsIsNoGround) {
  const std::vector<std::string> options{"--footprint-m", "60", "--search-m", "60", "--step-m", "80", "--json"};
  const auto survey = [&](const std::string& package) {
    std::vector<std::string> words{"cache", "matchability", package};
    words.insert(words.end(), options.begin(), options.end());
    EXPECT_EQ(run(words), 0) << err_.str();
    return json::parse(out_.str());
  };
  const json plain = survey(maker_.make(folder_).string());
  EXPECT_FALSE(plain.contains("water_areas"));
  const LonLatBox everywhere{10.9, 47.9, 11.1, 48.1};
  const std::string lake = vectors_geojson({"us",
                                            "MIT",
                                            {{VectorClass::water,
                                              "lake",
                                              true,
                                              {{{everywhere.west_deg, everywhere.south_deg},
                                                {everywhere.east_deg, everywhere.south_deg},
                                                {everywhere.east_deg, everywhere.north_deg},
                                                {everywhere.west_deg, everywhere.north_deg},
                                                {everywhere.west_deg, everywhere.south_deg}}}}}});
  maker_.edit_manifest = [&](Manifest& manifest) {
    const auto package = folder_ / "flooded";
    std::filesystem::create_directories(package / "vectors");
    write_file_atomic(package / kVectorsFile, lake);
    manifest.artifacts.push_back(describe_file(package, kVectorsFile, kRoleVectors));
    manifest.artifacts.back().vectors = VectorFacts{"us", "MIT", sha256(as_bytes("source")), 0, 1, 0, 0};
  };
  const fs::path package = maker_.make(folder_, "flooded");
  const json flooded = survey(package.string());
  EXPECT_EQ(flooded["water_areas"], 1);
  EXPECT_EQ(flooded["share"]["poor"], 1.0);
  EXPECT_LT(plain["share"]["poor"].get<double>(), 1.0);

  ASSERT_EQ(run({"cache", "inspect", package.string(), "--json"}), 0);
  EXPECT_NE(out_.str().find("\"licence\": \"MIT\""), std::string::npos) << out_.str();
  write_file_atomic(folder_ / "root.json", sign_root(maker_.root, {&maker_.signer}).json());
  ASSERT_EQ(run({"cache", "verify", package.string(), "--trust", path("root.json"), "--report", path("report")}), 0)
      << out_.str() << err_.str();
  EXPECT_NE(out_.str().find("1 feature of water"), std::string::npos) << out_.str();
  EXPECT_NE(read_text_file(folder_ / "report" / "report.html").find("\"attribution\":\"us\""), std::string::npos);

  // Vectors that are not those of the manifest say nothing.
  write_file_atomic(package / kVectorsFile, lake + " ");
  EXPECT_EQ(run({"cache", "matchability", package.string(), "--footprint-m", "60"}), 2);
  EXPECT_NE(err_.str().find("not that of its manifest"), std::string::npos) << err_.str();
}

TEST_F(CacheMatchability, IsShownInTheReportOfVerify) {
  const std::string package = maker_.make(folder_).string();
  write_file_atomic(folder_ / "root.json", sign_root(maker_.root, {&maker_.signer}).json());
  ASSERT_EQ(
      run({"cache", "verify", package, "--trust", path("root.json"), "--report", path("report"), "--matchability"}), 0)
      << out_.str() << err_.str();
  EXPECT_NE(out_.str().find("longest segment without a good place"), std::string::npos);
  const std::string html = read_text_file(folder_ / "report" / "report.html");
  const std::string open = "<script type=\"application/json\" id=\"data\">";
  const auto begin = html.find(open) + open.size();
  const json layer = json::parse(html.substr(begin, html.find("</script>", begin) - begin))["map"]["matchability"];
  EXPECT_EQ(layer["cells"].size(), layer["places"].get<std::size_t>());
  EXPECT_EQ(layer["stretches"].size(), layer["without_good"].size());
  EXPECT_EQ(html.find("{{"), std::string::npos) << "a place of the page was not filled";
  EXPECT_EQ(html.find("<!doctype html>"), 0U);
  EXPECT_EQ(html.find("src=\"http"), std::string::npos);

  ASSERT_EQ(run({"cache", "verify", package, "--trust", path("root.json"), "--report", path("plain")}), 0);
  EXPECT_EQ(read_text_file(folder_ / "plain" / "report.html").find("\"matchability\":{"), std::string::npos);
}

class MatchabilityInPackage : public CacheMatchability {
 protected:
  MatchabilityInPackage() : package_(maker_.make(folder_)) {
    write_file_atomic(folder_ / "p.key.pem", maker_.signer.pem(), 0600);
    write_file_atomic(folder_ / "root.json", sign_root(maker_.root, {&maker_.signer}).json());
  }
  int put(std::vector<std::string> more) {
    std::vector<std::string> args{
        "cache",    "matchability", package_.string(), "--footprint-m", "60", "--search-m", "60",
        "--step-m", "80",           "--into-package"};
    args.insert(args.end(), more.begin(), more.end());
    return run(args);
  }
  fs::path map() const { return package_ / kMatchabilityFile; }
  Findings verify(VerifyDepth depth = VerifyDepth::quick) const { return maker_.verify(package_, depth).findings; }

  fs::path package_;
};

TEST_F(MatchabilityInPackage, IsSignedVerifiedAndEqualToTheFileOfOut) {
  ASSERT_EQ(put({"--key", path("p.key.pem"), "--out", path("m.tif"), "--json"}), 0) << out_.str() << err_.str();
  EXPECT_EQ(read_file(map()), read_file(folder_ / "m.tif"));
  const json result = json::parse(out_.str());
  EXPECT_EQ(result["bytes"], fs::file_size(map()));
  EXPECT_EQ(result["signed"], true);
  EXPECT_TRUE(verify(VerifyDepth::full).empty()) << test::codes(verify(VerifyDepth::full));
  NoProgress progress;
  EXPECT_NE(open_package(package_, maker_.options(), progress).package, nullptr) << "as aircraft open it";
  const auto info = test::run_process({"gdalinfo", "-json", map().string()});
  ASSERT_EQ(info.code, 0) << info.err;
  EXPECT_EQ(json::parse(info.out)["bands"][3]["description"], "class");

  // Again: the same bytes. With an index beside it: both are there.
  const Bytes manifest = read_file(package_ / kManifestFile);
  ASSERT_EQ(put({"--key", path("p.key.pem")}), 0) << err_.str();
  EXPECT_NE(out_.str().find("matchability/matchability.tif"), std::string::npos) << out_.str();
  EXPECT_EQ(read_file(package_ / kManifestFile), manifest);
  ASSERT_EQ(run({"cache", "index", package_.string(), "--overlap-percent", "10", "--key", path("p.key.pem")}), 0)
      << err_.str();
  EXPECT_TRUE(fs::exists(map()));
  EXPECT_TRUE(verify(VerifyDepth::full).empty());
}

TEST_F(MatchabilityInPackage, OfSeveralMachinesIsThatOfOne) {
  ASSERT_EQ(put({"--key", path("p.key.pem")}), 0) << err_.str();
  const Bytes alone = read_file(map()), manifest = read_file(package_ / kManifestFile);
  fs::create_directory(folder_ / "work");
  const auto shard = [&](const std::string& number, const std::string& footprint = "60") {
    return run({"cache", "matchability", package_.string(), "--footprint-m", footprint, "--search-m", "60", "--step-m",
                "80", "--shards", path("work"), "--shard", number, "--json"});
  };
  for (const int shards : {1, 3}) {
    fs::remove_all(folder_ / "work");
    fs::create_directory(folder_ / "work");
    std::size_t tasks = 0;
    for (int i = 1; i <= shards; ++i) {
      ASSERT_EQ(shard(std::to_string(i) + "/" + std::to_string(shards)), 0) << err_.str();
      tasks += json::parse(out_.str())["tasks"].get<std::size_t>();
    }
    EXPECT_GT(tasks, 8U);
    ASSERT_EQ(put({"--key", path("p.key.pem"), "--shards", path("work"), "--out", path("m.tif")}), 0) << err_.str();
    EXPECT_EQ(read_file(map()), alone);
    EXPECT_EQ(read_file(folder_ / "m.tif"), alone);
    EXPECT_EQ(read_file(package_ / kManifestFile), manifest);
  }
  // Of other options, and what does not go together.
  fs::remove_all(folder_ / "work" / "matchability-2-of-3");
  ASSERT_EQ(shard("2/3", "50"), 0) << err_.str();
  EXPECT_EQ(put({"--key", path("p.key.pem"), "--shards", path("work")}), 2);
  EXPECT_NE(err_.str().find("footprint 50 m"), std::string::npos) << err_.str();
  EXPECT_EQ(put({"--key", path("p.key.pem"), "--shards", path("work"), "--shard", "1/3"}), 2);
  EXPECT_EQ(run({"cache", "matchability", (package_ / kImageryFile).string(), "--mission",
                 (package_ / kMissionFile).string(), "--shards", path("work")}),
            2);
  EXPECT_EQ(shard("4/3"), 2);
}

TEST_F(MatchabilityInPackage, DetectsEveryFlippedByteAndItsRemoval) {
  ASSERT_EQ(put({"--key", path("p.key.pem")}), 0) << err_.str();
  const Bytes sound = read_file(map());
  for (std::size_t at = 0; at < sound.size(); at += 1 + sound.size() / 7) {
    Bytes bytes = sound;
    bytes[at] ^= 1;
    write_file_atomic(map(), bytes);
    EXPECT_EQ(test::codes(verify()), "artifact.hash") << at;
  }
  fs::remove(map());
  EXPECT_TRUE(verify().contains("artifact.missing"));
}

// The map is of the old tiles.
TEST_F(MatchabilityInPackage, IsNotCarriedOverByAnUpdate) {
  ASSERT_EQ(put({"--key", path("p.key.pem")}), 0) << err_.str();
  folder_.write("next.yaml", test::mission_yaml({{"sequence: 3", "sequence: 4"}}));
  ASSERT_EQ(run({"cache", "update", package_.string(), "--trust", path("root.json"), "--mission", path("next.yaml"),
                 "--key", path("p.key.pem"), "--out", path("new")}),
            0)
      << out_.str() << err_.str();
  EXPECT_NE(err_.str().find("matchability/matchability.tif is not carried over"), std::string::npos) << err_.str();
  EXPECT_FALSE(fs::exists(folder_ / "new/matchability"));
}

TEST_F(MatchabilityInPackage, NamesMissingOptionsAndChangesNothing) {
  const Bytes manifest = read_file(package_ / kManifestFile);
  EXPECT_EQ(put({}), 2);
  EXPECT_NE(err_.str().find("--key"), std::string::npos) << err_.str();
  folder_.write("mission.yaml", test::mission_yaml());
  EXPECT_EQ(put({"--key", path("p.key.pem"), "--mission", path("mission.yaml")}), 2);
  EXPECT_EQ(put({"--key", path("none.pem")}), 2);
  EXPECT_EQ(run({"cache", "matchability", package_.string(), "--key", path("p.key.pem")}), 2) << "--key alone";
  EXPECT_EQ(run({"cache", "matchability", (package_ / kImageryFile).string(), "--into-package"}), 2);
  EXPECT_EQ(read_file(package_ / kManifestFile), manifest);
  EXPECT_TRUE(verify(VerifyDepth::full).empty());
  test::sqlite(package_ / kImageryFile, "UPDATE tiles SET tile_data = x'00'");
  EXPECT_EQ(put({"--key", path("p.key.pem")}), 1) << "not what was signed";
  EXPECT_FALSE(fs::exists(map()));
}

TEST_F(CacheMatchability, NamesMissingOptions) {
  const fs::path package = maker_.make(folder_);
  EXPECT_EQ(run({"cache", "matchability", (package / kImageryFile).string()}), 2);
  EXPECT_NE(err_.str().find("--mission"), std::string::npos);
  EXPECT_EQ(run({"cache", "matchability", path("none")}), 2);
  EXPECT_EQ(run({"cache", "matchability", package.string(), "--step-m", "0"}), 2);
  EXPECT_EQ(run({"cache", "matchability", package.string(), "--camera", path("none.yaml")}), 2);
  EXPECT_EQ(run({"cache", "matchability", package.string(), "--out", path("no/such/folder.tif")}), 2);
  folder_.write("text.mbtiles", "no database");
  folder_.write("mission.yaml", test::mission_yaml());
  EXPECT_EQ(run({"cache", "matchability", path("text.mbtiles"), "--mission", path("mission.yaml")}), 2);
  test::sqlite(package / kImageryFile, "UPDATE tiles SET tile_data = x'00'");
  EXPECT_EQ(run({"cache", "matchability", package.string(), "--out", path("m.tif")}), 2) << "tiles that do not decode";
  EXPECT_FALSE(fs::exists(path("m.tif")));
  EXPECT_TRUE(out_.str().empty());
  EXPECT_EQ(run({"cache", "verify", package.string(), "--trust", path("none"), "--matchability"}), 2) << "no --report";
}

}  // namespace
}  // namespace nadir
