// Packages with a COG, against GDAL's own reader, and COGs that GDAL makes.
#include <fmt/format.h>
#include <gdal_priv.h>

#include <opencv2/imgproc.hpp>

#include "base/error.hpp"
#include "imagery/cog_reader.hpp"
#include "imagery/mbtiles.hpp"
#include "package_build/package_builder_fixture.hpp"

namespace nadir {
namespace {

namespace fs = std::filesystem;

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
