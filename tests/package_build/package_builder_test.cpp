#include "package_build/package_builder.hpp"
#include "base/progress.hpp"
#include "package_build/build_estimate.hpp"

#include <fmt/format.h>
#include <gdal_priv.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <unistd.h>
#include <fstream>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>
#include <set>

#include "base/error.hpp"
#include "base/files.hpp"
#include "imagery/codecs.hpp"
#include "imagery/cog_reader.hpp"
#include "imagery/map_window.hpp"
#include "imagery/mbtiles.hpp"
#include "package/vector_layer.hpp"
#include "package_build/package_builder_fixture.hpp"
#include "support/small_disk.hpp"

namespace nadir {
namespace {

namespace fs = std::filesystem;
using test::PackageBuilder;
using test::ResumedBuild;

TEST_F(PackageBuilder, MakesACompletePackage) {
  const PackageReport report = build(request("package"));
  ASSERT_FALSE(report.findings.has_errors());
  const fs::path package = folder_ / "package";
  for (const auto name : {kManifestFile, kSignatureFile, kMissionFile, kImageryFile}) {
    EXPECT_TRUE(fs::is_regular_file(package / name)) << name;
  }
  EXPECT_EQ(read_file(package / kMissionFile), read_file(folder_ / "mission.yaml"));
  EXPECT_THAT(left_behind(), testing::ElementsAre("package"));

  const auto parsed = parse_manifest(read_file(package / kManifestFile));
  ASSERT_TRUE(parsed.manifest);
  const Artifact* imagery = parsed.manifest->artifact(kRoleImagery);
  ASSERT_NE(imagery, nullptr);
  EXPECT_EQ(imagery->sha256, sha256_file(package / kImageryFile));
  ASSERT_TRUE(imagery->tiles);
  EXPECT_EQ(imagery->tiles->count, report.tiles);
  EXPECT_EQ(imagery->tiles->merkle_root, report.merkle_root);

  const MbtilesReader reader(package / kImageryFile);
  EXPECT_EQ(reader.zooms().min, 14);
  EXPECT_EQ(reader.zooms().max, 19);
  EXPECT_EQ(reader.metadata().at("format"), "jpg");
  const auto sha = test::run_process({"sqlite3", (package / kImageryFile).string(),
                                      "SELECT count(*) FROM tiles JOIN nadir_sidecars USING (zoom_level, tile_column, "
                                      "tile_row); SELECT count(*) FROM tiles; PRAGMA integrity_check"});
  EXPECT_EQ(sha.out, fmt::format("{0}\n{0}\nok\n", report.tiles));
}

TEST_F(PackageBuilder, TheMapShowsTheRastersColoursAtEveryZoom) {
  ASSERT_FALSE(build(request("package")).findings.has_errors());
  const MbtilesReader reader(folder_ / "package" / kImageryFile);
  const auto& t = *spec_.transform;
  // The centres of a bright and a dark check.
  for (const auto& [column, row, red] :
       {std::array{13.5 + 27 * 30, 13.5 + 27 * 30, 210.0}, std::array{13.5 + 27 * 31, 13.5 + 27 * 30, 90.0}}) {
    const auto place = test::project(32651, "EPSG:4326", {t[0] + t[1] * column, t[3] + t[5] * row});
    const LocalFrame frame({place.x, place.y});
    for (const double gsd_m : {0.27, 0.6, 1.2}) {  // zooms 19, 18, 17
      const MapWindow window = read_map_window(reader, frame, {-2.4, -2.4, 2.4, 2.4}, gsd_m, Colour::bgr);
      const int middle = window.image.rows / 2;
      EXPECT_NEAR(window.image.at<cv::Vec3b>(middle, middle)[2], red, 14.0) << gsd_m;
      EXPECT_EQ(cv::countNonZero(window.mask), window.mask.rows * window.mask.cols);
    }
  }
}

TEST_F(PackageBuilder, VectorsAreAPartOfThePackage) {
  const auto& t = *spec_.transform;
  const auto at = [&](double column, double row) {
    const auto place = test::project(32651, "EPSG:4326", {t[0] + t[1] * column, t[3] + t[5] * row});
    return fmt::format("[{:.7f},{:.7f}]", place.x, place.y);
  };
  folder_.write("osm.geojson",
                R"({"type":"FeatureCollection","features":[{"type":"Feature","properties":{"highway":"track"},
                "geometry":{"type":"LineString","coordinates":[)" +
                    at(100, 100) + "," + at(1500, 1500) + "]}}]}");
  PackageRequest wanted = request("package");
  wanted.vectors = VectorRequest{folder_ / "osm.geojson", "the surveyors", "CC0-1.0"};
  const PackageReport report = build(wanted);
  ASSERT_FALSE(report.findings.has_errors());
  ASSERT_TRUE(report.vectors);
  EXPECT_EQ(report.vectors->roads, 1U);
  const auto parsed = parse_manifest(read_file(folder_ / "package" / kManifestFile));
  const Artifact* artifact = parsed.manifest->artifact(kRoleVectors);
  ASSERT_NE(artifact, nullptr);
  EXPECT_EQ(artifact->sha256, sha256_file(folder_ / "package" / kVectorsFile));
  EXPECT_EQ(artifact->vectors, report.vectors);
  EXPECT_EQ(parse_vectors(read_file(folder_ / "package" / kVectorsFile), "v").features.size(), 1U);
  wanted.out = folder_ / "again";
  build(wanted);
  expect_same_files(folder_ / "package", folder_ / "again");

  // All else is as without them, and a build without them knows nothing of them.
  ASSERT_FALSE(build(request("plain")).findings.has_errors());
  EXPECT_EQ(read_file(folder_ / "plain" / kImageryFile), read_file(folder_ / "package" / kImageryFile));
  EXPECT_FALSE(fs::exists(folder_ / "plain" / "vectors"));
  EXPECT_EQ(read_text_file(folder_ / "plain" / kManifestFile).find("vectors"), std::string::npos);

  // A licence that is not known stops the build before anything is made.
  wanted.out = folder_ / "unknown";
  wanted.vectors->licence.reset();
  EXPECT_THROW(build(wanted), UsageError);
  EXPECT_FALSE(fs::exists(folder_ / "unknown"));
}

TEST_F(PackageBuilder, GdalOpensTheTiles) {
  if (test::run_shell("command -v gdalinfo").code != 0) GTEST_SKIP() << "NOT TESTED: gdalinfo is not installed";
  ASSERT_FALSE(build(request("package")).findings.has_errors());
  const auto result = test::run_process({"gdalinfo", "-checksum", (folder_ / "package" / kImageryFile).string()});
  EXPECT_EQ(result.code, 0) << result.err;
  EXPECT_THAT(result.out, testing::HasSubstr("Driver: MBTiles"));
  EXPECT_THAT(result.out, testing::HasSubstr("Overviews:"));
  EXPECT_THAT(result.out, testing::HasSubstr("ZOOM_LEVEL=19"));
}

TEST_F(PackageBuilder, SameInputsSameBytesWithAnyNumberOfThreads) {
  for (const int threads : {1, 2, 3}) build(request(fmt::format("package{}", threads), threads));
  build(request("again", 2));
  expect_same_files(folder_ / "package1", folder_ / "package2");
  expect_same_files(folder_ / "package1", folder_ / "package3");
  expect_same_files(folder_ / "package2", folder_ / "again");
}

TEST_F(PackageBuilder, EveryTileFormat) {
  for (const ImageFormat format : {ImageFormat::png, ImageFormat::webp}) {
    PackageRequest wanted = request(std::string(name_of(format)));
    wanted.tiles.encoding = {format, 80};
    ASSERT_FALSE(build(wanted).findings.has_errors());
    const MbtilesReader reader(wanted.out / kImageryFile);
    auto tile = reader.database().prepare("SELECT tile_data FROM tiles");
    while (tile.step()) EXPECT_EQ(sniff_image_format(tile.blob(0)), format);
  }
}

// The frame of nodata around the image is rotated against the tiles, so edge tiles are partly empty.
TEST_F(PackageBuilder, EdgesAreMaskedAndNeverBlack) {
  spec_.nodata = 0;
  hole_ = [](int column, int row) { return column < 300 || row < 250 || column >= 1300; };
  write_map("map.tif");
  ASSERT_FALSE(build(request("package")).findings.has_errors());
  const MbtilesReader reader(folder_ / "package" / kImageryFile);
  auto rows = reader.database().prepare(
      "SELECT zoom_level, tile_column, tile_row, valid_ppm FROM nadir_sidecars WHERE valid_ppm < 1000000");
  int edge_tiles = 0;
  while (rows.step()) {
    const TileKey key =
        TileKey::from_tms(static_cast<std::uint8_t>(rows.integer(0)), static_cast<std::uint32_t>(rows.integer(1)),
                          static_cast<std::uint32_t>(rows.integer(2)));
    ++edge_tiles;
    const auto bytes = reader.read_mask(key);
    ASSERT_TRUE(bytes) << to_text(key);
    const cv::Mat mask = decode_image(*bytes, Colour::grey, "mask").image;
    EXPECT_NEAR(static_cast<double>(cv::countNonZero(mask)) / 65536.0 * 1e6, static_cast<double>(rows.integer(3)), 1.0);
    const cv::Mat tile = decode_image(*reader.read(key), Colour::grey, "tile").image;
    double darkest = 0;
    cv::minMaxLoc(tile, &darkest);
    EXPECT_GT(darkest, 60) << to_text(key);  // the field's darkest grey is 105
  }
  EXPECT_GT(edge_tiles, 5);
}

TEST_F(PackageBuilder, WithoutAKeyThereIsNoSignature) {
  PackageRequest unsigned_one = request("package");
  unsigned_one.key = nullptr;
  ASSERT_FALSE(build(unsigned_one).findings.has_errors());
  EXPECT_FALSE(fs::exists(unsigned_one.out / kSignatureFile));
}

// Imagery as others hand it out: the same map, by the pixel, as from the GeoTIFF that GDAL made it of.
class BuildFrom : public PackageBuilder, public testing::WithParamInterface<std::string> {};
INSTANTIATE_TEST_SUITE_P(WhatGdalWrites, BuildFrom, testing::Values("GPKG", "MBTILES"));

TEST_P(BuildFrom, ShowsTheSameMap) {
  if (test::run_shell("command -v gdal_translate").code != 0) GTEST_SKIP() << "NOT TESTED: no gdal_translate";
  const fs::path other = folder_ / ("map." + GetParam());
  std::vector<std::string> convert{"gdal_translate", "-q", "-of", GetParam(), "-co", "TILE_FORMAT=PNG"};
  if (GetParam() == "MBTILES") convert.insert(convert.end(), {"-co", "ZOOM_LEVEL_STRATEGY=UPPER", "-r", "bilinear"});
  convert.insert(convert.end(), {folder_ / "map.tif", other});
  const auto made = test::run_process(convert);
  ASSERT_EQ(made.code, 0) << made.err;
  test::write_item(other);
  PackageRequest wanted = request("package");
  wanted.imagery = {other};
  const PackageReport from_other = build(wanted), from_tif = build(request("whole"));
  ASSERT_FALSE(from_other.findings.has_errors());
  EXPECT_EQ(from_other.tiles, from_tif.tiles);
  const MbtilesReader ours(folder_ / "package" / kImageryFile), theirs(folder_ / "whole" / kImageryFile);
  int compared = 0;
  for (const std::uint8_t zoom : {std::uint8_t{19}, std::uint8_t{17}}) {
    const auto place =
        test::project(32651, "EPSG:4326", {(*spec_.transform)[0] + 240, (*spec_.transform)[3] - 240});  // its middle
    const TileKey middle = tile_at({place.x, place.y}, zoom);
    for (std::uint32_t x = middle.x - 1; x <= middle.x + 1; ++x) {
      const auto a = ours.read({zoom, x, middle.y}), b = theirs.read({zoom, x, middle.y});
      ASSERT_TRUE(a && b);
      const cv::Mat mine = decode_image(*a, Colour::bgr, "a").image,
                    other_one = decode_image(*b, Colour::bgr, "b").image;
      EXPECT_LT(cv::norm(mine, other_one, cv::NORM_L1) / static_cast<double>(mine.total() * 3), 4.0) << int{zoom};
      ++compared;
    }
  }
  EXPECT_EQ(compared, 6);
}

TEST_F(PackageBuilder, TheFirstRasterLiesOnTop) {
  write_map("old.tif", {255, 0, 0});
  test::write_item(folder_ / "old.tif", "2023-12-01T00:00:00Z", 0.4, "archive");
  spec_.width = 800;  // the new one covers the western half
  write_map("map.tif");
  PackageRequest both = request("package");
  both.imagery = {folder_ / "map.tif", folder_ / "old.tif"};
  ASSERT_FALSE(build(both).findings.has_errors());
  const auto sources = test::run_process({"sqlite3", (both.out / kImageryFile).string(),
                                          "SELECT DISTINCT source, substr(captured_at, 1, 10), gsd_mm FROM "
                                          "nadir_sidecars WHERE zoom_level = 19 ORDER BY 1"});
  EXPECT_EQ(sources.out, "archive|2023-12-01|400\narchive + survey|2023-12-01|400\nsurvey|2024-03-01|300\n");
}

TEST_F(PackageBuilder, TheNewestOrFinestLiesOnTopWhenAskedFor) {
  write_map("old.tif");
  test::write_item(folder_ / "old.tif", "2023-12-01T00:00:00Z", 0.28, "archive");
  for (const auto& [order, source] :
       {std::pair{MosaicOrder::priority, "archive\n"}, std::pair{MosaicOrder::newest, "survey\n"},
        std::pair{MosaicOrder::finest, "archive\n"}}) {
    PackageRequest both = request(fmt::format("map.{}", static_cast<int>(order)));
    both.imagery = {folder_ / "old.tif", folder_ / "map.tif"};
    both.tiles.mosaic.order = order;
    ASSERT_FALSE(build(both).findings.has_errors());
    const auto sources = test::run_process(
        {"sqlite3", (both.out / kImageryFile).string(), "SELECT DISTINCT source FROM nadir_sidecars"});
    EXPECT_EQ(sources.out, source);
  }
}

TEST_F(PackageBuilder, FeatheredSeamsAreTheSameForAnyNumberOfThreadsAndNotWithoutLimit) {
  write_map("old.tif", {255, 0, 0});
  spec_.width = 800;
  write_map("map.tif");
  PackageRequest both = request("map.1", 1);
  both.imagery = {folder_ / "map.tif", folder_ / "old.tif"};
  both.tiles.mosaic.feather_m = 8;
  ASSERT_FALSE(build(both).findings.has_errors());
  both.out = folder_ / "map.3";
  both.tiles.threads = 3;
  ASSERT_FALSE(build(both).findings.has_errors());
  expect_same_files(folder_ / "map.1", folder_ / "map.3");
  both.out = folder_ / "map.far";
  both.tiles.mosaic.feather_m = 500;
  EXPECT_THROW(build(both), UsageError);
}

TEST_F(PackageBuilder, AHoleInTheRequiredAreaIsAGap) {
  spec_.nodata = 0;
  hole_ = [](int column, int row) { return std::hypot(column - 800, row - 700) < 20; };
  write_map("map.tif");
  expect_refused(request("package"), "coverage.gap");
}

TEST_F(PackageBuilder, ImageryThatEndsTooEarlyIsAGap) {
  spec_.width = 1000;
  write_map("map.tif");
  expect_refused(request("package"), "coverage.gap");
  (*spec_.transform)[0] += 50'000;  // somewhere else
  write_map("map.tif");
  expect_refused(request("package"), "coverage.elsewhere");
}

TEST_F(PackageBuilder, RejectsStaleCoarseAndOversizedPackages) {
  write_mission(200);
  expect_refused(request("package"), "freshness.stale");
  write_mission(400);
  PackageRequest late = request("package");
  late.at = parse_utc("2024-11-29T00:00:00Z");
  write_mission(260);
  expect_refused(late, "freshness.stale");
  late.at = parse_utc("2024-12-01T00:00:00Z");
  write_mission(4000);
  expect_refused(late, "package.expired");
  write_mission(400, 1);
  test::write_item(folder_ / "map.tif", "2024-03-01T00:00:00Z", 0.8);
  expect_refused(request("package"), "resolution.coarse");
  test::write_item(folder_ / "map.tif");
  PackageRequest large = request("package");
  large.tiles.encoding = {ImageFormat::png, 75};
  hole_ = nullptr;
  test::write_raster(folder_ / "map.tif", spec_, [](int column, int row) -> std::array<int, 4> {
    const int noise = (column * 7919 + row * 104729 + column * row * 31) % 256;
    return {noise, (noise * 7) % 256, (noise * 13) % 256, 255};
  });
  expect_refused(large, "budget.exceeded");
  // Given up early: what it has so far is the least, and what it would have is foretold.
  const Finding over = build(large).findings.items().front();
  EXPECT_NE(over.found.find("at least"), std::string::npos) << over.found;
  EXPECT_NE(over.found.find("expected"), std::string::npos) << over.found;
}

TEST_F(PackageBuilder, WarnsOfAMissionThatHasExpiredMeanwhile) {
  PackageRequest late = request("late");
  late.now = UtcTime{4'000'000'000};
  const PackageReport report = build(late);
  EXPECT_FALSE(report.findings.has_errors());
  EXPECT_TRUE(report.findings.contains("package.expired"));
}

TEST_F(PackageBuilder, AStatedResolutionIsComparedWithThePixels) {
  PackageRequest fine = request("package");
  fine.overrides.gsd_m = 0.001;
  expect_refused(fine, "resolution.implausible");
  fine.overrides.gsd_m = 0.15;  // pixels of 0.3 m
  const PackageReport doubtful = build(fine);
  EXPECT_FALSE(doubtful.findings.has_errors());
  EXPECT_TRUE(doubtful.findings.contains("resolution.implausible")) << "the tiles do not answer it";
  fine = request("plausible");
  fine.overrides.gsd_m = 0.25;
  const PackageReport plausible = build(fine);
  EXPECT_FALSE(plausible.findings.has_errors());
  EXPECT_FALSE(plausible.findings.contains("resolution.implausible"));
}

TEST_F(PackageBuilder, AMissionElsewhereIsOneFinding) {
  (*spec_.transform)[0] += 50'000;
  write_map("map.tif");
  const PackageReport report = build(request("package"));
  ASSERT_EQ(report.findings.items().size(), 1U) << to_text(report.findings.items().back());
  EXPECT_EQ(report.findings.items().front().code, "coverage.elsewhere");
  EXPECT_NE(report.findings.items().front().found.find("50 km away"), std::string::npos)
      << report.findings.items().front().found;
  EXPECT_TRUE(left_behind().empty());
}

TEST_F(PackageBuilder, TheEstimateFromImageryIsWithinTenPercent) {
  const PackageRequest wanted = request("package");
  const PackageReport report = build(wanted);
  const Mission mission = read_mission(wanted.mission);
  const auto inputs = open_imagery(wanted.imagery, wanted.overrides, wanted.stretches);
  NoProgress progress;
  const BuildEstimate estimate =
      estimate_build(mission, tile_format_figures("jpeg").value(), inputs, wanted.tiles, progress);
  EXPECT_NEAR(static_cast<double>(estimate.tiles), static_cast<double>(report.tiles),
              0.1 * static_cast<double>(report.tiles));
  EXPECT_NEAR(estimate.bytes, static_cast<double>(report.bytes), 0.1 * static_cast<double>(report.bytes));
}

TEST_F(PackageBuilder, ErrorsLeaveNothing) {
  PackageRequest bad = request("package");
  bad.imagery = {folder_ / "missing.tif"};
  EXPECT_THROW(build(bad), Error);
  bad = request("package");
  bad.mission = folder_ / "missing.yaml";
  EXPECT_THROW(build(bad), Error);
  // Damage that shows only when the pixels are read.
  spec_.tiled = true;
  write_map("map.tif");
  const Bytes whole = read_file(folder_ / "map.tif");
  std::ofstream(folder_ / "map.tif", std::ios::binary)
      .write(as_text(whole).data(), static_cast<std::streamsize>(whole.size() * 6 / 10));
  EXPECT_THROW(build(request("package")), Error);
  EXPECT_THAT(left_behind(), testing::IsEmpty());
  fs::create_directory(folder_ / "package");
  write_map("map.tif");
  EXPECT_THROW(build(request("package")), Error);  // never replaces
}

TEST_F(PackageBuilder, UnsupportedZoomsAreRejected) {
  std::string text = read_text_file(folder_ / "mission.yaml");
  text.replace(text.find("max: 19"), 7, "max: 23");
  folder_.write("mission.yaml", text);
  EXPECT_THROW(build(request("package")), UsageError);
}

class StopAtOnce final : public Progress {
 public:
  void begin(std::string_view, std::uint64_t, std::string_view) override {}
  void advance(std::uint64_t) override { throw Interrupted(); }
  void end() override {}
};

TEST_F(PackageBuilder, AnInterruptedBuildLeavesNothing) {
  StopAtOnce progress;
  EXPECT_THROW(build_package(request("package"), progress), Interrupted);
  EXPECT_THAT(left_behind(), testing::IsEmpty());
}

TEST_F(PackageBuilder, AKilledBuildLeavesNoPackageAndTheNextOneWorks) {
  build_and_kill(request("package"), kFirstTiles);
  EXPECT_FALSE(fs::exists(folder_ / "package"));
  EXPECT_FALSE(build(request("package")).findings.has_errors());
  EXPECT_THAT(left_behind(), testing::ElementsAre("package"));
}

class ResumedBuildOf : public ResumedBuild, public testing::WithParamInterface<TileSetKind> {
 protected:
  PackageRequest in_container(PackageRequest wanted) const {
    wanted.tiles.container = GetParam();
    return wanted;
  }
  PackageRequest fresh(const std::string& out, int threads = 2) { return in_container(request(out, threads)); }
  PackageRequest resumed(const std::string& out, int threads = 2) { return in_container(resuming(out, threads)); }
};
INSTANTIATE_TEST_SUITE_P(Containers, ResumedBuildOf, testing::Values(TileSetKind::mbtiles, TileSetKind::cog),
                         [](const auto& kind) { return kind.param == TileSetKind::cog ? "Cog" : "Mbtiles"; });

// Progress is reported after each metatile and around each later step.
TEST_P(ResumedBuildOf, IsIdenticalWhereverItWasKilled) {
  const auto whole = run_build(fresh("whole"), 0);
  ASSERT_EQ(whole.code, 0) << whole.err;
  const int events = std::stoi(whole.out), last_tiles = events - 6;
  ASSERT_GT(last_tiles, kFirstTiles + 1);
  std::set<int> moments{1, kFirstTiles, (kFirstTiles + last_tiles) / 2};
  for (int event = last_tiles; event < events; ++event) moments.insert(event);
  for (const int event : moments) {
    const int threads = 1 + event % 3;
    build_and_kill(fresh("package", threads), event);
    EXPECT_FALSE(fs::exists(folder_ / "package")) << event;
    if (event == last_tiles) build_and_kill(resumed("package", threads), kFirstTiles);  // may happen as well
    const PackageReport report = build(resumed("package"));
    ASSERT_FALSE(report.findings.has_errors());
    // From the first metatile until the journal is removed, right before the commit.
    EXPECT_EQ(report.resumed > 0, event >= kFirstTiles && event < events - 1) << event;
    expect_same_files(folder_ / "whole", folder_ / "package");
    EXPECT_THAT(left_behind(), testing::UnorderedElementsAre("whole", "package")) << event;
    fs::remove_all(folder_ / "package");
  }
  build_and_kill(fresh("package"), events);  // right after the commit: the lock stays, and blocks no other build
  expect_same_files(folder_ / "whole", folder_ / "package");
  EXPECT_THAT(left_behind(), testing::UnorderedElementsAre("whole", "package", ".package.lock"));
}

TEST_F(ResumedBuild, TakesMetatilesFromTheJournal) {
  build_and_kill(request("package"), kFirstTiles);
  EXPECT_FALSE(fs::exists(folder_ / "package"));
  const PackageReport report = build(resuming("package"));
  EXPECT_GT(report.resumed, 0);
  EXPECT_THAT(remarks_, testing::IsEmpty());
  ASSERT_FALSE(build(request("whole")).findings.has_errors());
  expect_same_files(folder_ / "whole", folder_ / "package");
}

TEST_F(ResumedBuild, OtherInputsOrOptionsAreRejectedAndNothingIsLost) {
  build_and_kill(request("package"), kFirstTiles);
  PackageRequest other = resuming("package");
  other.tiles.encoding.quality = 60;
  EXPECT_THROW(build(other), UsageError);
  other = resuming("package");
  other.overrides.gsd_m = 0.31;
  EXPECT_THROW(build(other), UsageError);
  other = resuming("package");
  other.key = nullptr;
  EXPECT_THROW(build(other), UsageError);
  const Bytes map = read_file(folder_ / "map.tif");
  write_map("map.tif", {209, 190, 150});
  EXPECT_THROW(build(resuming("package")), UsageError);
  std::ofstream(folder_ / "map.tif", std::ios::binary)
      .write(as_text(map).data(), static_cast<std::streamsize>(map.size()));
  EXPECT_GT(build(resuming("package")).resumed, 0);
}

TEST_F(ResumedBuild, WithoutResumeItStartsAgainAndReportsIt) {
  build_and_kill(request("package"), kFirstTiles);
  PackageRequest restart = resuming("package");
  restart.resume = false;
  EXPECT_EQ(build(restart).resumed, 0);
  EXPECT_THAT(remarks_, testing::ElementsAre(testing::HasSubstr("--resume")));
  remarks_.clear();
  EXPECT_EQ(build(resuming("another")).resumed, 0);
  EXPECT_THAT(remarks_, testing::ElementsAre(testing::HasSubstr("nothing to resume")));
}

// A file system that is too small for the package; growing it lets the same build end.
TEST_F(ResumedBuild, AFullDiskLosesNothing) {
  const fs::path small = folder_ / "map.small";
  test::SmallDisk disk(small, "size=600k");
  if (!disk.mounted()) GTEST_SKIP() << "NOT TESTED: a full disk needs root and a tmpfs to mount";
  ASSERT_FALSE(build(request("whole")).findings.has_errors());
  PackageRequest wanted = resuming("map.small/package");
  try {
    build(wanted);
    FAIL() << "600 kB are enough";
  } catch (const OutOfSpace& error) {
    EXPECT_THAT(error.text().fix, testing::HasSubstr("--resume"));
  }
  EXPECT_FALSE(fs::exists(wanted.out));
  ASSERT_TRUE(disk.resize("64m"));
  EXPECT_GT(build(wanted).resumed, 0);
  expect_same_files(folder_ / "whole", wanted.out);
}

TEST_F(ResumedBuild, AReadOnlyMediumIsReported) {
  const fs::path fixed = folder_ / "map.fixed";
  test::SmallDisk disk(fixed, "ro,size=64k");
  if (!disk.mounted()) GTEST_SKIP() << "NOT TESTED: a read-only medium needs root and a tmpfs to mount";
  try {
    build(request("map.fixed/package"));
    ADD_FAILURE() << "built on a read-only medium";
  } catch (const Error& error) {
    EXPECT_THAT(error.text().found + error.text().fix, testing::HasSubstr("read-only"));
  }
}

TEST_F(ResumedBuild, AFolderWithoutPermissionIsReported) {
  if (::geteuid() != 0) GTEST_SKIP() << "NOT TESTED: creating another user's folder needs root";
  fs::permissions(folder_.path(), static_cast<fs::perms>(0755));
  const auto result = run_build(request("package"), 0, "65534");
  EXPECT_EQ(result.code, 2);
  EXPECT_THAT(result.err, testing::HasSubstr("package"));
  EXPECT_THAT(result.err, testing::HasSubstr("check the permissions"));
  EXPECT_THAT(left_behind(), testing::IsEmpty());
}

// Packages with a COG, against GDAL's own reader, and COGs that GDAL makes.

using Dataset = std::unique_ptr<GDALDataset, void (*)(GDALDataset*)>;

Dataset open_raster(const fs::path& path) {
  GDALAllRegister();
  return {static_cast<GDALDataset*>(GDALOpen(path.c_str(), GA_ReadOnly)), [](GDALDataset* open) { GDALClose(open); }};
}

// A tile of an image (full resolution or overview) as GDAL decodes it.
cv::Mat tile_by_gdal(GDALDataset& file, int overview, int column, int row) {
  cv::Mat rgb(kTileSize, kTileSize, CV_8UC3);
  for (int band = 0; band < 3; ++band) {
    GDALRasterBand* from = file.GetRasterBand(band + 1);
    if (overview >= 0) from = from->GetOverview(overview);
    EXPECT_EQ(from->RasterIO(GF_Read, column * kTileSize, row * kTileSize, kTileSize, kTileSize, rgb.data + band,
                             kTileSize, kTileSize, GDT_Byte, 3, 3 * kTileSize, nullptr),
              CE_None);
  }
  cv::Mat bgr;
  cv::cvtColor(rgb, bgr, cv::COLOR_RGB2BGR);
  return bgr;
}

void expect_gdal_sees_the_same(const fs::path& path) {
  const Dataset file = open_raster(path);
  ASSERT_NE(file, nullptr);
  const CogReader reader(path);
  int tiles = 0;
  for (std::size_t i = 0; i < reader.levels().size(); ++i) {
    const CogLevel& level = reader.levels()[i];
    if (level.picture.width < kTileSize) continue;  // a part of a tile
    for (const TileKey& key : reader.keys()) {
      if (key.z != level.zoom || (i == 0 && (key.x + key.y) % 13 != 0)) continue;
      const cv::Mat ours = decode_image(reader.read(key).value(), Colour::bgr, to_text(key)).image;
      const cv::Mat theirs =
          tile_by_gdal(*file, static_cast<int>(i) - 1, static_cast<int>(key.x - level.west / kTileSize),
                       static_cast<int>(key.y - level.north / kTileSize));
      EXPECT_EQ(cv::norm(ours, theirs, cv::NORM_INF), 0) << to_text(key);
      ++tiles;
    }
  }
  EXPECT_GT(tiles, 8);
}

class CogPackages : public test::PackageBuilder {
 protected:
  PackageRequest cog(const std::string& out, TileEncoding encoding = {}) {
    PackageRequest wanted = request(out);
    wanted.tiles.container = TileSetKind::cog;
    wanted.tiles.encoding = encoding;
    return wanted;
  }
};

TEST_F(CogPackages, HoldTheTilesOfAnMbtilesPackage) {
  const PackageReport mbtiles = build(request("mbtiles")), in_cog = build(cog("cog"));
  ASSERT_FALSE(in_cog.findings.has_errors());
  EXPECT_EQ(in_cog.merkle_root, mbtiles.merkle_root);
  const MbtilesReader a(folder_ / "mbtiles" / kImageryFile);
  const CogReader b(folder_ / "cog" / kCogFile);
  EXPECT_EQ(b.keys().size(), in_cog.tiles);
  for (const TileKey& key : b.keys()) EXPECT_EQ(a.read(key), b.read(key)) << to_text(key);
  EXPECT_EQ(build(cog("again")).merkle_root, mbtiles.merkle_root);
  expect_same_files(folder_ / "cog", folder_ / "again");
}

TEST_F(CogPackages, GdalReadsTheSamePixels) {
  for (const auto& [name, encoding] : {std::pair{"jpeg", TileEncoding{}},
                                       {"webp", TileEncoding{ImageFormat::webp, 80}},
                                       {"lossless", TileEncoding{ImageFormat::webp, 75, true}}}) {
    ASSERT_FALSE(build(cog(name, encoding)).findings.has_errors());
    expect_gdal_sees_the_same(folder_ / name / kCogFile);
  }
}

TEST_F(CogPackages, AreGeoreferencedAndLaidOutAsACog) {
  ASSERT_FALSE(build(cog("cog")).findings.has_errors());
  const fs::path path = folder_ / "cog" / kCogFile;
  const Dataset file = open_raster(path);
  ASSERT_NE(file, nullptr);
  EXPECT_STREQ(file->GetMetadataItem("LAYOUT", "IMAGE_STRUCTURE"), "COG");
  EXPECT_EQ(file->GetRasterBand(1)->GetOverviewCount(), 5);  // zooms 14 to 18
  const CogReader reader(path);
  std::array<double, 6> place{};
  ASSERT_EQ(file->GetGeoTransform(place.data()), CE_None);
  const double half = 20037508.342789244, pixel = 2 * half / 256 / (1 << 19);
  EXPECT_NEAR(place[1], pixel, 1e-12);
  EXPECT_NEAR((place[0] + half) / pixel, static_cast<double>(reader.levels()[0].west), 1e-4);
  EXPECT_NEAR((half - place[3]) / pixel, static_cast<double>(reader.levels()[0].north), 1e-4);
  EXPECT_STREQ(file->GetSpatialRef()->GetAuthorityCode(nullptr), "3857");
}

TEST_F(CogPackages, AResumedBuildIsIdentical) {
  ASSERT_FALSE(build(cog("whole")).findings.has_errors());
  class StopLater final : public Progress {
   public:
    void begin(std::string_view, std::uint64_t, std::string_view) override {}
    void advance(std::uint64_t) override { throw OutOfSpace({.what = "as if the disk were full"}); }
    void end() override {}
  } stop;
  PackageRequest wanted = cog("package");
  EXPECT_THROW(build_package(wanted, stop), OutOfSpace);
  EXPECT_FALSE(fs::exists(wanted.out));
  wanted.resume = true;
  EXPECT_GT(build(wanted).resumed, 0);
  expect_same_files(folder_ / "whole", folder_ / "package");
}

// Others' COGs on the same grid: shared JPEG tables, deflate, blocks of 512 pixels.
TEST_F(CogPackages, ReadsCogsMadeByGdal) {
  if (test::run_shell("command -v gdal_translate").code != 0) GTEST_SKIP() << "NOT TESTED: gdal_translate is missing";
  ASSERT_FALSE(build(cog("cog")).findings.has_errors());
  // 8 x 8 tiles in the middle are enough, and save seconds.
  const CogReader whole(folder_ / "cog" / kCogFile);
  std::vector<TileKey> keys = whole.keys();
  std::erase_if(keys, [](const TileKey& key) { return key.z != 19; });
  const TileKey middle = keys[keys.size() / 2];
  const std::int64_t left = middle.x / 8 * 2048 - whole.levels()[0].west;
  const std::int64_t top = middle.y / 8 * 2048 - whole.levels()[0].north;
  const std::string window = fmt::format("-srcwin {} {} 2048 2048", left, top);
  for (const char* options :
       {"-co COMPRESS=JPEG -co ADD_ALPHA=NO", "-co COMPRESS=DEFLATE -co LEVEL=1 -co PREDICTOR=YES",
        "-co COMPRESS=NONE -co BLOCKSIZE=512"}) {
    const fs::path path = folder_ / "theirs.tif";
    const auto made = test::run_shell(fmt::format("gdal_translate -q -of COG {} {} '{}' '{}'", window, options,
                                                  (folder_ / "cog" / kCogFile).string(), path.string()));
    ASSERT_EQ(made.code, 0) << made.err;
    expect_gdal_sees_the_same(path);
  }
}

TEST_F(CogPackages, ARasterOnAnotherGridIsReported) {
  try {
    const CogReader reader(folder_ / "map.tif");
    ADD_FAILURE();
  } catch (const TiffError& error) {
    EXPECT_STREQ(error.code(), "tiff.grid");
    EXPECT_EQ(error.text().found, "EPSG:32651");
  }
}

}  // namespace
}  // namespace nadir
