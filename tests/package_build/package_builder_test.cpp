#include "package_build/package_builder.hpp"

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <opencv2/core.hpp>

#include "base/files.hpp"
#include "imagery/codecs.hpp"
#include "imagery/map_window.hpp"
#include "imagery/mbtiles_reader.hpp"
#include "package_build/package_builder_fixture.hpp"

namespace nadir {
namespace {

namespace fs = std::filesystem;
using test::PackageBuilder;

TEST_F(PackageBuilder, MakesAWholePackage) {
  const PackageReport report = build(request("package"));
  ASSERT_FALSE(report.findings.refuses());
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
  ASSERT_FALSE(build(request("package")).findings.refuses());
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

TEST_F(PackageBuilder, GdalOpensTheTiles) {
  if (test::run_shell("command -v gdalinfo").code != 0) GTEST_SKIP() << "NOT TESTED: gdalinfo is not installed";
  ASSERT_FALSE(build(request("package")).findings.refuses());
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
    ASSERT_FALSE(build(wanted).findings.refuses());
    const MbtilesReader reader(wanted.out / kImageryFile);
    auto tile = reader.database().prepare("SELECT tile_data FROM tiles");
    while (tile.step()) EXPECT_EQ(sniff_image_format(tile.blob(0)), format);
  }
}

// The frame of nodata around the picture is turned against the tiles, so rim tiles are partly empty.
TEST_F(PackageBuilder, RimsAreMaskedAndNeverBlack) {
  spec_.nodata = 0;
  hole_ = [](int column, int row) { return column < 300 || row < 250 || column >= 1300; };
  write_map("map.tif");
  ASSERT_FALSE(build(request("package")).findings.refuses());
  const MbtilesReader reader(folder_ / "package" / kImageryFile);
  auto rows = reader.database().prepare(
      "SELECT zoom_level, tile_column, tile_row, valid_ppm FROM nadir_sidecars WHERE valid_ppm < 1000000");
  int rims = 0;
  while (rows.step()) {
    const TileKey key =
        TileKey::from_tms(static_cast<std::uint8_t>(rows.integer(0)), static_cast<std::uint32_t>(rows.integer(1)),
                          static_cast<std::uint32_t>(rows.integer(2)));
    ++rims;
    const auto bytes = reader.read_mask(key);
    ASSERT_TRUE(bytes) << to_text(key);
    const cv::Mat mask = decode_image(*bytes, Colour::grey, "mask").image;
    EXPECT_NEAR(static_cast<double>(cv::countNonZero(mask)) / 65536.0 * 1e6, static_cast<double>(rows.integer(3)), 1.0);
    const cv::Mat tile = decode_image(*reader.read(key), Colour::grey, "tile").image;
    double darkest = 0;
    cv::minMaxLoc(tile, &darkest);
    EXPECT_GT(darkest, 60) << to_text(key);  // the field's darkest grey is 105
  }
  EXPECT_GT(rims, 5);
}

TEST_F(PackageBuilder, WithoutAKeyThereIsNoSignature) {
  PackageRequest unsigned_one = request("package");
  unsigned_one.key = nullptr;
  ASSERT_FALSE(build(unsigned_one).findings.refuses());
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
  ASSERT_FALSE(from_other.findings.refuses());
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

}  // namespace
}  // namespace nadir
