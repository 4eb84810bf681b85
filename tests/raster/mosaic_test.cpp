#include "raster/mosaic.hpp"

#include <gtest/gtest.h>

#include <opencv2/core.hpp>

#include "base/error.hpp"
#include "raster/raster_source.hpp"
#include "raster/test_raster.hpp"
#include "support/process.hpp"
#include "support/temporary_folder.hpp"

namespace nadir {
namespace {

namespace fs = std::filesystem;

// Rasters in Web Mercator whose pixels are those of zoom 19, laid from the corner of a tile on.
class Mosaic : public testing::Test {
 protected:
  static constexpr int kZoom = 19;
  static constexpr std::int64_t kColumn = 437'900, kRow = 225'800;

  // first, count: columns of pixels from the corner's tile on.
  fs::path write(const std::string& name, int first, int count, std::array<int, 4> colour) {
    const double pixel_m = mercator_pixel_m(kZoom), half_m = pixel_m * kTileSize * (1 << (kZoom - 1));
    test::RasterSpec spec;
    spec.epsg = 3857;
    spec.width = count;
    spec.height = kSide;
    spec.transform = {{static_cast<double>(kColumn * kTileSize + first) * pixel_m - half_m, pixel_m, 0,
                       half_m - static_cast<double>(kRow * kTileSize) * pixel_m, 0, -pixel_m}};
    test::write_raster(folder_ / name, spec, [&](int, int) { return colour; });
    return folder_ / name;
  }

  struct Result {
    MaskedImage image{cv::Mat::zeros(kSide, kSide, CV_8UC3), cv::Mat::zeros(kSide, kSide, CV_8UC1)};
    TileGrid used{kTiles};
  };

  // The square of tiles, the given part of it.
  Result composed(const std::vector<fs::path>& paths, double feather_px, cv::Rect part = {0, 0, kSide, kSide}) {
    std::vector<ImageryInput> inputs;
    for (const fs::path& path : paths) inputs.push_back({path, {}, RasterSource(path).outline()});
    Result result;
    const cv::Point corner(static_cast<int>(kColumn) * kTileSize, static_cast<int>(kRow) * kTileSize);
    compose_layers(kZoom, part + corner, part.tl(), feather_px, layers_of(inputs), result.image, result.used);
    return result;
  }

  static constexpr int kTiles = 8, kSide = kTiles * kTileSize;
  static constexpr int kEdge = 700;  // the upper one ends there
  test::TemporaryFolder folder_;
};

TEST_F(Mosaic, FeatheredSeamsFadeLinearly) {
  const fs::path upper = write("upper.tif", 0, kEdge, {200, 100, 40, 255});
  const fs::path lower = write("lower.tif", 0, kSide, {100, 200, 240, 255});
  constexpr double kFeather = 50;
  const Result result = composed({upper, lower}, kFeather);
  for (const int row : {300, 1023, 1024, 1500}) {
    for (int column = kEdge - 80; column < kEdge + 20; ++column) {
      const double alpha = std::clamp((kEdge - column) / kFeather, 0.0, 1.0);
      const cv::Vec3b found = result.image.bgr.at<cv::Vec3b>(row, column);
      EXPECT_NEAR(found[2], 200 * alpha + 100 * (1 - alpha), 2.5) << row << " " << column;
      EXPECT_NEAR(found[0], 40 * alpha + 240 * (1 - alpha), 4.5) << row << " " << column;
    }
  }
  EXPECT_EQ(cv::countNonZero(result.image.mask), kSide * kSide);
  // Tile 2 spans pixels 512 to 767: both show, the upper one more.
  EXPECT_EQ(result.used.at(1, 3).size(), 1U);
  ASSERT_EQ(result.used.at(2, 3).size(), 2U);
  EXPECT_GT(result.used.at(2, 3).at(0), result.used.at(2, 3).at(1));
  EXPECT_NEAR(static_cast<double>(result.used.at(2, 3).at(0)), (kEdge - 512 - kFeather / 2) * kTileSize, 600);
  EXPECT_EQ(result.used.at(4, 3).count(0), 0U);
}

// As an area of many files: a hundred strips, more than may be open at once, read from both ends and through the seams.
TEST_F(Mosaic, ManyRastersAreOpenedWhereTheyLie) {
  constexpr int kStrip = 20;
  std::vector<fs::path> strips;
  for (int i = 0; i < 100; ++i) {
    strips.push_back(write("strip" + std::to_string(i) + ".tif", i * kStrip, kStrip,
                           {2 * i + 20, 200 - i, i % 2 == 0 ? 40 : 90, 255}));
  }
  const Result whole = composed(strips, 0);
  EXPECT_EQ(cv::countNonZero(whole.image.mask), 100 * kStrip * kSide);
  for (const int i : {0, 1, 50, 99}) {
    EXPECT_EQ(whole.image.bgr.at<cv::Vec3b>(1000, i * kStrip + kStrip / 2)[2], 2 * i + 20) << i;
    const int tile = (i * kStrip + kStrip / 2) / kTileSize;
    EXPECT_TRUE(whole.used.at(tile, 3).contains(static_cast<std::size_t>(i))) << i;
  }
  // A strip far away is not even opened: it may be missing.
  fs::remove(strips[99]);
  std::vector<ImageryInput> inputs;
  for (const fs::path& path : {strips[0], strips[98]}) inputs.push_back({path, {}, RasterSource(path).outline()});
  inputs.push_back({strips[99], {}, {{1e6, 1e6}, {1.001e6, 1e6}, {1.001e6, 1.001e6}}});
  Result part;
  const cv::Point corner(static_cast<int>(kColumn) * kTileSize, static_cast<int>(kRow) * kTileSize);
  compose_layers(kZoom, cv::Rect(corner, cv::Size(kSide, kSide)), {0, 0}, 0, layers_of(inputs), part.image, part.used);
  EXPECT_EQ(cv::countNonZero(part.image.mask), 2 * kStrip * kSide);
}

TEST_F(Mosaic, HardSeamsDoNotFade) {
  const fs::path upper = write("upper.tif", 0, kEdge, {200, 100, 40, 255});
  const fs::path lower = write("lower.tif", 0, kSide, {100, 200, 240, 255});
  const Result result = composed({upper, lower}, 0);
  EXPECT_EQ(result.image.bgr.at<cv::Vec3b>(900, kEdge - 3), cv::Vec3b(40, 100, 200));
  EXPECT_EQ(result.image.bgr.at<cv::Vec3b>(900, kEdge + 3), cv::Vec3b(240, 200, 100));
}

// At the edge of all imagery there is nothing to fade into, and equal colours stay unchanged everywhere.
TEST_F(Mosaic, NothingFadesAtTheOuterEdge) {
  const fs::path west = write("west.tif", 100, 700, {90, 120, 70, 255});
  const fs::path east = write("east.tif", 600, 900, {90, 120, 70, 255});
  const Result result = composed({west, east}, 80);
  for (int column = 101; column < 1499; ++column) {
    ASSERT_EQ(result.image.bgr.at<cv::Vec3b>(1000, column), cv::Vec3b(70, 120, 90)) << column;
  }
  EXPECT_EQ(result.image.mask.at<std::uint8_t>(1000, 98), 0);
  EXPECT_EQ(result.image.mask.at<std::uint8_t>(1000, 1502), 0);
}

// Fading continues into other chunks and metatiles.
TEST_F(Mosaic, PartsEqualTheWhole) {
  const fs::path upper = write("upper.tif", 0, 1040, {200, 100, 40, 255});  // ends just beyond a chunk of 1024
  const fs::path lower = write("lower.tif", 0, kSide, {100, 200, 240, 255});
  const Result whole = composed({upper, lower}, 60);
  const cv::Rect part(3 * kTileSize, kTileSize, kTileSize, 2 * kTileSize);
  const Result alone = composed({upper, lower}, 60, part);
  EXPECT_LE(cv::norm(whole.image.bgr(part), alone.image.bgr(part), cv::NORM_INF), 1.0);
  EXPECT_NEAR(whole.image.bgr.at<cv::Vec3b>(500, 1020)[2], 100 + 100 * 20 / 60.0, 3.0);
}

TEST(MosaicOrderOf, NewestAndFinest) {
  std::vector<ImageryInput> inputs(4);
  const std::array names = {"a", "b", "c", "d"};
  const std::array days = {1, 3, 2, 3};
  const std::array gsds = {0.5, 0.4, 0.3, 0.3};
  for (std::size_t i = 0; i < 4; ++i) {
    inputs[i].path = names[i];
    inputs[i].facts = {.captured_at = {days[i] * 86400}, .gsd_m = gsds[i], .ce90_m = 1, .provider = "p"};
  }
  const auto order = [&](MosaicOrder wanted) {
    std::string text;
    for (const ImageryInput& input : in_order(inputs, wanted)) text += input.path.string();
    return text;
  };
  EXPECT_EQ(order(MosaicOrder::priority), "abcd");
  EXPECT_EQ(order(MosaicOrder::newest), "bdca");
  EXPECT_EQ(order(MosaicOrder::finest), "cdba");
}

class Containers : public Mosaic, public testing::WithParamInterface<std::string> {};
INSTANTIATE_TEST_SUITE_P(ThatGdalWrites, Containers, testing::Values("VRT", "COG", "MBTILES", "GPKG"));

TEST_P(Containers, ShowTheSamePixels) {
  if (test::run_shell("command -v gdal_translate").code != 0)
    GTEST_SKIP() << "NOT TESTED: gdal_translate is not installed";
  const fs::path map = write("map.tif", 0, kSide, {200, 100, 40, 255});
  const fs::path other = folder_ / ("other." + (GetParam() == "VRT" ? std::string("vrt") : GetParam()));
  const auto made = test::run_process({"gdal_translate", "-q", "-of", GetParam(), map.string(), other.string()});
  ASSERT_EQ(made.code, 0) << made.err;
  const Result result = composed({other}, 0);
  const cv::Rect inner(10, 10, kSide - 20, kSide - 20);
  EXPECT_EQ(cv::countNonZero(result.image.mask(inner)), inner.area());
  EXPECT_LE(cv::norm(result.image.bgr(inner) - cv::Scalar(40, 100, 200), cv::NORM_INF), 3.0);
}

TEST_F(Mosaic, RemoteImageryIsRejected) {
  const fs::path map = write("map.tif", 0, 256, {200, 100, 40, 255});
  const auto expect_remote = [](const fs::path& path) {
    try {
      const RasterSource source(path);
      FAIL() << path;
    } catch (const UsageError& error) {
      EXPECT_EQ(error.text().what, "remote rasters are not read unless they are pinned") << path;
    }
  };
  expect_remote("/vsicurl/https://example.org/map.tif");
  expect_remote("https://example.org/map.tif");
  const std::string inside = R"(<VRTDataset rasterXSize="256" rasterYSize="256"><SRS>EPSG:3857</SRS>
<GeoTransform>0,1,0,0,0,-1</GeoTransform><VRTRasterBand dataType="Byte" band="1"><SimpleSource>
<SourceFilename relativeToVRT="0">/vsicurl/http://127.0.0.1:9/map.tif</SourceFilename><SourceBand>1</SourceBand>
<SourceProperties RasterXSize="256" RasterYSize="256" DataType="Byte" BlockXSize="256" BlockYSize="256"/>
</SimpleSource></VRTRasterBand></VRTDataset>)";
  expect_remote(folder_.write("remote.vrt", inside));
  std::string outside = inside;
  const std::string name = "/vsicurl/http://127.0.0.1:9/map.tif";
  outside.replace(outside.find(name), name.size(), (folder_ / "remote.vrt").string());
  expect_remote(folder_.write("nested.vrt", outside));
}

}  // namespace
}  // namespace nadir
