// nadir cache index as a user calls it, and the findings of verification on invalid indexes.
#include <fmt/format.h>
#include <gtest/gtest.h>
#include <cmath>
#include <cstring>
#include <fstream>
#include <nlohmann/json.hpp>
#include <opencv2/core.hpp>

#include "base/csv.hpp"
#include "base/files.hpp"
#include "base/random.hpp"
#include "commands/command_fixture.hpp"
#include "imagery/codecs.hpp"
#include "package/package_maker.hpp"
#include "package/package_roots.hpp"
#include "package/package_writer.hpp"
#include "support/process.hpp"
#include "vision/place_index.hpp"
#include "vision/place_index_files.hpp"

namespace nadir {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;

class CacheIndex : public test::CommandTest {
 protected:
  CacheIndex() { write_file_atomic(key(), maker_.signer.pem(), 0600); }
  int index(std::vector<std::string> args) {
    args.insert(args.begin(), {"cache", "index"});
    args.insert(args.end(), {"--overlap-percent", "40"});  // few squares, so that the tests are quick
    return run(std::move(args));
  }
  fs::path indexed(const std::string& name = "package") {
    const fs::path package = maker_.make(folder_, name);
    EXPECT_EQ(index({package.string(), "--key", key().string()}), 0) << err_.str();
    return package;
  }
  fs::path key() const { return folder_ / "p.key.pem"; }
  static std::map<std::string, Sha256> contents(const fs::path& folder) {
    std::map<std::string, Sha256> all;
    for (const auto& entry : fs::recursive_directory_iterator(folder)) {
      if (entry.is_regular_file()) all[entry.path().lexically_relative(folder)] = sha256_file(entry.path());
    }
    return all;
  }
  Findings verify(const fs::path& package, VerifyDepth depth) {
    NoProgress progress;
    Verification verification = maker_.verify(package, depth);
    verify_place_index(depth, progress, verification);
    return verification.findings;
  }
  // As a deceived signer would: manifest and signature match the files as they are.
  void sign_as_it_is(const fs::path& package, bool with_vectors = true) {
    Manifest manifest = *parse_manifest(read_file(package / kManifestFile)).manifest;
    std::erase_if(manifest.artifacts, [](const Artifact& artifact) { return artifact.path.starts_with("index/"); });
    manifest.artifacts.push_back(describe_file(package, kPlaceTableFile, kRolePlaceTable));
    if (with_vectors) manifest.artifacts.push_back(describe_file(package, kPlaceIndexFile, kRolePlaceIndex));
    write_manifest(package, manifest);
    maker_.sign(package);
  }
  static void overwrite(const fs::path& file, std::string_view bytes) { write_file_atomic(file, bytes); }
};

TEST_F(CacheIndex, TheIndexedPackageIsAcceptedAndReproducible) {
  const fs::path package = indexed();
  EXPECT_NE(out_.str().find("places of 120 m"), std::string::npos) << out_.str();
  EXPECT_TRUE(verify(package, VerifyDepth::quick).empty()) << test::codes(verify(package, VerifyDepth::quick));
  EXPECT_TRUE(verify(package, VerifyDepth::full).empty()) << test::codes(verify(package, VerifyDepth::full));
  const auto first = contents(package);
  ASSERT_EQ(index({package.string(), "--key", key().string()}), 0) << "again: the old index is replaced";
  EXPECT_EQ(contents(package), first);
  for (const auto& entry : fs::directory_iterator(folder_.path())) {
    EXPECT_FALSE(entry.path().filename().string().starts_with(".package")) << entry.path();
  }
  NoProgress progress;
  Opening opening = open_package(package, maker_.options(), progress);
  verify_place_index(VerifyDepth::quick, progress, opening);
  EXPECT_NE(opening.package, nullptr);
}

TEST_F(CacheIndex, OfSeveralMachinesIsThatOfOne) {
  const auto alone = contents(indexed("alone"));
  const fs::path package = maker_.make(folder_);
  const std::string work = folder_ / "work";
  const auto shard = [&](int number, int shards) {
    return index({package.string(), "--shards", work, "--shard", fmt::format("{}/{}", number, shards)});
  };
  for (const int shards : {1, 2, 3, 8}) {
    fs::remove_all(work);
    fs::create_directory(work);
    for (int i = shards; i >= 1; --i) ASSERT_EQ(shard(i, shards), 0) << err_.str();
    ASSERT_EQ(index({package.string(), "--shards", work, "--key", key().string()}), 0) << err_.str();
    EXPECT_EQ(contents(package), alone) << shards;
  }
  ASSERT_EQ(shard(8, 8), 0);
  EXPECT_NE(out_.str().find("complete already"), std::string::npos) << out_.str();
  fs::remove_all(fs::path(work) / "index-5-of-8");
  EXPECT_EQ(index({package.string(), "--shards", work, "--key", key().string()}), 2);
  EXPECT_NE(err_.str().find("index " + package.string() + " --shards"), std::string::npos) << err_.str();

  // A tile that was changed, dates that were, another mission: nothing is made of them.
  const Bytes tiles = read_file(package / kImageryFile), mission = read_file(package / kMissionFile);
  fs::remove_all(work);
  fs::create_directory(work);
  test::sqlite(package / kImageryFile, "UPDATE tiles SET tile_data = zeroblob(length(tile_data))");
  EXPECT_EQ(shard(1, 1), 2);
  EXPECT_NE(err_.str().find("a tile of the package is damaged"), std::string::npos) << err_.str();
  write_file_atomic(package / kImageryFile, tiles);
  test::sqlite(package / kImageryFile, "UPDATE nadir_sidecars SET captured_at = '2024-04-02T00:00:00Z'");
  EXPECT_EQ(shard(1, 1), 1);
  EXPECT_NE(out_.str().find("tiles.root"), std::string::npos) << out_.str();
  write_file_atomic(package / kImageryFile, tiles);
  write_file_atomic(package / kMissionFile, std::string(as_text(mission)) + "#");
  EXPECT_EQ(shard(1, 1), 2);
  EXPECT_NE(err_.str().find("not that of its manifest"), std::string::npos) << err_.str();
  EXPECT_FALSE(fs::exists(fs::path(work) / "index-1-of-1"));
}

TEST_F(CacheIndex, ASignedPackageIsNotChangedWithoutItsKey) {
  const fs::path package = maker_.make(folder_);
  const auto before = contents(package);
  EXPECT_EQ(index({package.string()}), 2);
  EXPECT_NE(err_.str().find("--key"), std::string::npos) << err_.str();
  EXPECT_EQ(contents(package), before);
}

TEST_F(CacheIndex, AnUnsignedPackageStaysUnsigned) {
  const fs::path package = maker_.make(folder_);
  fs::remove(package / kSignatureFile);
  ASSERT_EQ(index({package.string(), "--footprint-m", "100", "--footprint-m", "150", "--json"}), 0) << err_.str();
  const json document = json::parse(out_.str());
  EXPECT_EQ(document["layers"].size(), 2U);
  EXPECT_EQ(document["signed"], false);
  EXPECT_FALSE(fs::exists(package / kSignatureFile));
  maker_.sign(package);
  EXPECT_TRUE(verify(package, VerifyDepth::full).empty());
}

TEST_F(CacheIndex, KeepsOtherFilesAndRemovesLeftovers) {
  const fs::path package = maker_.make(folder_);
  fs::create_directories(package / kRootFolder);
  folder_.write("package/root/1.root.json", "{}");
  fs::create_directories(folder_ / ".package.amended");  // of a process that was killed
  folder_.write(".package.amended/rest", "x");
  ASSERT_EQ(index({package.string(), "--key", key().string()}), 0) << err_.str();
  EXPECT_EQ(read_text_file(package / "root/1.root.json"), "{}");
  EXPECT_FALSE(fs::exists(folder_ / ".package.amended"));
}

TEST_F(CacheIndex, RejectsDamagedPackagesAndExceededBudgets) {
  const fs::path damaged = maker_.make(folder_, "damaged");
  overwrite(damaged / kMissionFile, maker_.mission + "\n");
  EXPECT_EQ(index({damaged.string(), "--key", key().string()}), 1);
  EXPECT_NE(out_.str().find("artifact.size"), std::string::npos) << out_.str();

  maker_.mission = test::mission_yaml({{"budget_mb: 20", "budget_mb: 1"}});
  const fs::path tight = maker_.make(folder_, "tight");
  const auto before = contents(tight);
  EXPECT_EQ(index({tight.string(), "--key", key().string(), "--footprint-m", "16", "--footprint-m", "18"}), 1);
  EXPECT_NE(out_.str().find("budget.exceeded"), std::string::npos) << out_.str();
  EXPECT_EQ(contents(tight), before);
}

TEST_F(CacheIndex, NamesMissingOptions) {
  EXPECT_EQ(index({(folder_ / "none").string()}), 2);
  const fs::path package = maker_.make(folder_);
  EXPECT_EQ(index({package.string(), "--evaluate", "simulated"}), 2);
  EXPECT_NE(err_.str().find("nadir cache index"), std::string::npos) << err_.str();
  EXPECT_EQ(index({package.string(), "--key", key().string(), "--footprint-m", "10"}), 2) << "too few pixels";
  EXPECT_EQ(index({package.string(), "--key", key().string(), "--footprint-m", "nan"}), 2);
  EXPECT_EQ(index({package.string(), "--key", (folder_ / "none").string()}), 2);
  EXPECT_EQ(index({package.string(), "--key", key().string(), "--camera", (folder_ / "none").string()}), 2);
  EXPECT_TRUE(verify(package, VerifyDepth::full).empty());
}

TEST_F(CacheIndex, ReportsItsRecall) {
  const fs::path package = indexed();
  const auto before = contents(package);
  ASSERT_EQ(index({package.string(), "--evaluate", "simulated", "--views", "12", "--json"}), 0) << err_.str();
  const json document = json::parse(out_.str());
  EXPECT_EQ(document["heading_known"]["queries"], 12);
  EXPECT_GE(document["heading_known"]["recall_at_5"].get<double>(), 0.75);
  EXPECT_LE(document["heading_known"]["recall_at_1"], document["heading_known"]["recall_at_20"]);
  EXPECT_EQ(contents(package), before);
  ASSERT_EQ(index({package.string(), "--evaluate", "simulated", "--views", "2"}), 0);
  EXPECT_NE(out_.str().find("heading unknown"), std::string::npos);
  EXPECT_EQ(index({package.string(), "--evaluate", (folder_ / "none").string()}), 2);
}

TEST_F(CacheIndex, DetectsAnIndexOfOtherImagery) {
  const fs::path package = indexed();
  maker_.edit_tile = [](Sidecar& sidecar, Bytes& tile) {
    tile = test::noise_tile(7 + sidecar.key.x * 31 + sidecar.key.y);
    return true;
  };
  const fs::path other = indexed("other");
  for (const auto name : {kPlaceIndexFile, kPlaceTableFile}) {
    fs::copy_file(other / name, package / name, fs::copy_options::overwrite_existing);
  }
  sign_as_it_is(package);
  EXPECT_EQ(test::codes(verify(package, VerifyDepth::quick)), "index.mismatch");

  // With the root of this imagery written into its table, only a comparison with the tiles shows it.
  const Manifest manifest = *parse_manifest(read_file(package / kManifestFile)).manifest;
  json table = json::parse(read_text_file(package / kPlaceTableFile));
  table["imagery_merkle_root"] = manifest.artifact(kRoleImagery)->tiles->merkle_root.hex();
  overwrite(package / kPlaceTableFile, table.dump());
  sign_as_it_is(package);
  EXPECT_TRUE(verify(package, VerifyDepth::quick).empty());
  EXPECT_TRUE(verify(package, VerifyDepth::full).contains("index.mismatch"));
}

TEST_F(CacheIndex, DetectsIncompleteTruncatedOrForeignIndexes) {
  const fs::path package = indexed();
  const std::string table = read_text_file(package / kPlaceTableFile);
  const Bytes vectors = read_file(package / kPlaceIndexFile);

  sign_as_it_is(package, false);
  EXPECT_TRUE(verify(package, VerifyDepth::quick).contains("artifact.unexpected"));
  fs::rename(package / kPlaceIndexFile, folder_ / "vectors");
  EXPECT_EQ(test::codes(verify(package, VerifyDepth::quick)), "index.mismatch") << "only the table";
  fs::rename(folder_ / "vectors", package / kPlaceIndexFile);

  for (const std::size_t size : {std::size_t{0}, std::size_t{20}, std::size_t{45}, vectors.size() - 4}) {
    write_file_atomic(package / kPlaceIndexFile, ByteView(vectors).first(size));
    sign_as_it_is(package);
    EXPECT_EQ(test::codes(verify(package, VerifyDepth::quick)), "index.mismatch") << size;
  }
  Bytes hostile = vectors;
  hostile[15] = 0x7f;  // as many vectors as no machine has
  write_file_atomic(package / kPlaceIndexFile, hostile);
  sign_as_it_is(package);
  EXPECT_EQ(test::codes(verify(package, VerifyDepth::quick)), "index.mismatch");

  write_file_atomic(package / kPlaceIndexFile, vectors);
  json moved = json::parse(table);
  moved["origin_e7"][0] = moved["origin_e7"][0].get<std::int64_t>() + 1000;
  overwrite(package / kPlaceTableFile, moved.dump());
  sign_as_it_is(package);
  EXPECT_EQ(test::codes(verify(package, VerifyDepth::quick)), "index.mismatch");

  overwrite(package / kPlaceTableFile, table);
  EXPECT_TRUE(verify(package, VerifyDepth::quick).has_errors()) << "signed otherwise";
  sign_as_it_is(package);
  EXPECT_TRUE(verify(package, VerifyDepth::full).empty());
}

TEST_F(CacheIndex, DetectsEveryFlippedByte) {
  const fs::path package = indexed();
  for (const auto name : {kPlaceIndexFile, kPlaceTableFile}) {
    const Bytes sound = read_file(package / name);
    for (std::size_t at = 0; at < sound.size(); at += sound.size() / 5) {
      Bytes bytes = sound;
      bytes[at] ^= 1;
      write_file_atomic(package / name, bytes);
      EXPECT_EQ(test::codes(verify(package, VerifyDepth::quick)), "artifact.hash") << name << ' ' << at;
    }
    write_file_atomic(package / name, sound);
  }
}

// nadir cache index --evaluate DIR: the recall of an index over a flight whose truth is known.

constexpr std::string_view kCamera = R"(model: pinhole
width: 160
height: 120
fx: 160
fy: 160
cx: 80
cy: 60
distortion: []
uncertainty: {heading_deg: 3.0, agl_relative: 0.02, tilt_deg: 0.5}
)";

// A landscape that is the same at every zoom: fields of 14 m of different brightness, some of them in stripes.
Bytes landscape_tile(const TileKey& key) {
  cv::Mat image(kTileSize, kTileSize, CV_8UC3);
  const std::uint32_t step = 1U << (18 - key.z);  // pixels of zoom 18, 0.4 m
  for (int row = 0; row < kTileSize; ++row) {
    for (int column = 0; column < kTileSize; ++column) {
      const std::uint32_t x = (key.x * kTileSize + static_cast<std::uint32_t>(column)) * step;
      const std::uint32_t y = (key.y * kTileSize + static_cast<std::uint32_t>(row)) * step;
      std::uint32_t field = (x / 36) * 73856093U ^ (y / 36) * 19349663U;
      field = (field ^ field >> 13) * 0x5bd1e995U;
      const bool stripe = field % 3 == 0 && (field % 2 == 0 ? x : x + y) / 9 % 2 == 0;
      const auto grey = static_cast<std::uint8_t>(60 + field / 7 % 120 + (stripe ? 60 : 0));
      image.at<cv::Vec3b>(row, column) = {grey, grey, grey};
    }
  }
  return encode_image(image, ImageFormat::jpeg, 80);
}

class IndexEvaluation : public test::CommandTest {
 protected:
  // A package, its index, and a flight over its own imagery.
  void SetUp() override {
    if (test::run_shell("command -v gdal_translate").code != 0) GTEST_SKIP() << "NOT TESTED: no gdal_translate";
    maker_.edit_tile = [](Sidecar& sidecar, Bytes& tile) {
      tile = landscape_tile(sidecar.key);
      return true;
    };
    maker_.make(folder_, "package");
    write_file_atomic(folder_ / "p.key.pem", maker_.signer.pem(), 0600);
    folder_.write("camera.yaml", std::string(kCamera));
    const auto cut = test::run_process({"gdal_translate", "-q", "-of", "GTiff", "-b", "1", "-b", "2", "-b", "3",
                                        folder_ / "package/imagery/base.mbtiles", folder_ / "world.tif"});
    ASSERT_EQ(cut.code, 0) << cut.err;
    ASSERT_EQ(run({"cache", "index", "@package", "--key", "@p.key.pem", "--camera", "@camera.yaml", "--overlap-percent",
                   "50"}),
              0)
        << err_.str();
    ASSERT_EQ(run({"simulate", "flight", "--world", "@world.tif", "--mission", "@package/mission/mission.yaml",
                   "--camera", "@camera.yaml", "--frames", "6", "--interval-s", "1", "--out", "@flight"}),
              0)
        << err_.str();
  }
  json evaluate(std::initializer_list<std::string> more = {}) {
    std::vector<std::string> args{"cache", "index", "@package", "--evaluate", "@flight", "--json"};
    args.insert(args.end(), more);
    EXPECT_EQ(run(args), 0) << err_.str();
    return json::parse(out_.str());
  }
  // Exit code 2, a message that names what is meant, and a package that stays as it was.
  void expect_bad(const std::string& folder, const std::string& says) {
    EXPECT_EQ(run({"cache", "index", "@package", "--evaluate", "@" + folder}), 2) << says;
    EXPECT_NE(err_.str().find(says), std::string::npos) << err_.str();
    EXPECT_TRUE(out_.str().empty());
  }
  std::string text(const std::string& name) const { return read_text_file(folder_ / name); }
};

TEST_F(IndexEvaluation, CountsFramesRecalledAtEachRank) {
  const Sha256 before = sha256_file(folder_ / "package/manifest.json");
  const std::size_t frames = CsvTable::read(folder_ / "flight/telemetry.csv").rows();
  ASSERT_GE(frames, 5U);
  const json report = evaluate();
  for (const char* heading : {"heading_known", "heading_unknown"}) {
    const json& recall = report[heading];
    EXPECT_EQ(recall["queries"], frames) << heading;
    const double at_1 = recall["recall_at_1"], at_5 = recall["recall_at_5"], at_20 = recall["recall_at_20"];
    EXPECT_TRUE(0 <= at_1 && at_1 <= at_5 && at_5 <= at_20 && at_20 <= 1) << recall;
    for (const double share : {at_1, at_5, at_20}) {  // of whole frames
      EXPECT_NEAR(share * static_cast<double>(frames), std::round(share * static_cast<double>(frames)), 1e-9);
    }
    const double chance = recall["chance_at_5"];
    EXPECT_TRUE(chance > 0 && chance < 1) << recall;
    EXPECT_GE(recall["query_ms_max"], recall["query_ms_p50"]);
  }
  EXPECT_GE(report["heading_known"]["recall_at_1"], 0.5) << report;
  EXPECT_GE(report["heading_known"]["recall_at_5"], 0.75) << report;
  EXPECT_EQ(report["left_out"], 0);
  EXPECT_EQ(report["heading_range_deg"], 15);
  EXPECT_EQ(report["against"], (folder_ / "flight").string());
  EXPECT_EQ(sha256_file(folder_ / "package/manifest.json"), before);
  // The same seed gives the same queries and the same text.
  ASSERT_EQ(run({"cache", "index", "@package", "--evaluate", "@flight"}), 0);
  const auto text = fmt::format("recall@1 {:.1f} %", 100 * report["heading_known"]["recall_at_1"].get<double>());
  EXPECT_NE(out_.str().find(text), std::string::npos) << out_.str();
}

// With a false truth no answer is right, and the figure for chance shows it as well.
TEST_F(IndexEvaluation, SkipsFramesWithoutTruthOrImage) {
  const CsvTable truth = CsvTable::read(folder_ / "flight/truth.csv");
  std::string elsewhere = "frame,lat_deg,lon_deg\n";
  for (std::size_t row = 0; row + 2 < truth.rows(); ++row) {
    elsewhere += truth.cell(row, truth.required_column("frame")) + ",48.1,11.2\n";
  }
  folder_.write("flight/truth.csv", elsewhere);
  // A damaged image does no harm either; the rest of it may still decode.
  const fs::path picture = folder_ / "flight/frames/frame_0003.jpg";
  fs::resize_file(picture, fs::file_size(picture) / 3);
  const json report = evaluate();
  const std::size_t left_out = report["left_out"];
  EXPECT_TRUE(left_out == 2 || left_out == 3) << left_out;
  EXPECT_EQ(report["heading_known"]["queries"], truth.rows() - left_out);
  for (const char* heading : {"heading_known", "heading_unknown"}) {
    EXPECT_EQ(report[heading]["recall_at_20"], 0);
    EXPECT_EQ(report[heading]["chance_at_5"], 0);
  }
}

TEST_F(IndexEvaluation, NamesFoldersThatAreNotFlights) {
  fs::create_directory(folder_ / "empty");
  expect_bad("empty", "camera.yaml");
  expect_bad("nowhere", "nowhere");
  expect_bad("world.tif", "world.tif");
  const auto spoilt = [&](const std::string& name, const std::function<void(const fs::path&)>& spoil,
                          const std::string& says) {
    SCOPED_TRACE(name);
    fs::copy(folder_ / "flight", folder_ / name, fs::copy_options::recursive);
    spoil(folder_ / name);
    expect_bad(name, says);
  };
  spoilt(
      "no_truth", [](const fs::path& at) { fs::remove(at / "truth.csv"); }, "truth.csv");
  spoilt(
      "no_camera", [](const fs::path& at) { fs::remove(at / "camera.yaml"); }, "camera.yaml");
  spoilt(
      "no_frames", [](const fs::path& at) { fs::remove_all(at / "frames"); }, "frames");
  spoilt(
      "no_telemetry", [](const fs::path& at) { fs::remove(at / "telemetry.csv"); }, "telemetry.csv");
  const std::string frame = "frame_0003.jpg";
  for (const auto& [name, truth] : {std::pair{"nan", "frame,lat_deg,lon_deg\n" + frame + ",nan,11\n"},
                                    {"far", "frame,lat_deg,lon_deg\n" + frame + ",95,11\n"},
                                    {"other", std::string("frame,lat_deg,lon_deg\nother.jpg,48,11\n")},
                                    {"twice", "frame,lat_deg,lon_deg\n" + frame + ",48,11\n" + frame + ",48,11\n"},
                                    {"short", "frame,lat_deg\n" + frame + ",48\n"},
                                    {"none", std::string()}}) {
    spoilt(
        std::string("truth_") + name,
        [&, text = truth](const fs::path& at) { write_file_atomic(at / "truth.csv", text); }, "truth.csv");
  }
  EXPECT_TRUE(maker_.verify(folder_ / "package", VerifyDepth::full).findings.empty());
}

}  // namespace
}  // namespace nadir
