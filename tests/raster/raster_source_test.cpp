#include "raster/raster_source.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <fstream>
#include <opencv2/imgproc.hpp>

#include "base/error.hpp"
#include "base/files.hpp"
#include "geodesy/angles.hpp"
#include "raster/test_raster.hpp"
#include "support/temporary_folder.hpp"

namespace nadir {
namespace {

using test::Kind;
using test::RasterSpec;

GlobalPixel pixel_by_proj(int epsg, double x, double y, int zoom) {
  const auto mercator = test::project(epsg, "EPSG:3857", {x, y});
  const double half = kPi * 6378137.0, pixel = 2 * half / (256.0 * std::exp2(zoom));
  return {(mercator.x + half) / pixel, (half - mercator.y) / pixel};
}

// The part of the map around the middle of the raster.
MaskedImage middle_of(const std::filesystem::path& path, const RasterSpec& spec, int zoom, int side) {
  const auto& t = *spec.transform;
  const GlobalPixel centre =
      pixel_by_proj(spec.epsg, t[0] + t[1] * spec.width / 2, t[3] + t[5] * spec.height / 2, zoom);
  RasterSource source(path);
  return source.read(zoom, {static_cast<int>(centre.x) - side / 2, static_cast<int>(centre.y) - side / 2, side, side});
}

std::array<int, 4> plain(int, int) { return {200, 100, 50, 255}; }

struct Placement {
  int epsg;
  std::array<double, 6> transform;
  int zoom;
};

// Soft spots at known places of the raster must lie where PROJ says.
class RasterPositions : public testing::TestWithParam<Placement> {};
INSTANTIATE_TEST_SUITE_P(AnySystemAndScale, RasterPositions,
                         testing::Values(Placement{32651, {268'000, 0.3, 0, 2'685'300, 0, -0.3}, 19},  // about 1 : 1
                                         Placement{32651, {268'000, 0.3, 0, 2'685'300, 0, -0.3}, 20},  // enlarged
                                         Placement{32651, {268'000, 0.3, 0, 2'685'300, 0, -0.3}, 17},  // 3.6 to one
                                         Placement{32651, {268'000, 0.2, 0.1, 2'685'300, 0.1, -0.2}, 19},  // turned
                                         Placement{4326, {120.72, 3e-6, 0, 24.262, 0, -2.7e-6}, 19},       // degrees
                                         Placement{3857, {13'438'017.8, 0.4, 0, 2'785'494.6, 0, -0.4}, 18}));

TEST_P(RasterPositions, AgreeWithProj) {
  const test::TemporaryFolder folder;
  RasterSpec spec;
  spec.width = spec.height = 1200;
  spec.epsg = GetParam().epsg;
  spec.transform = GetParam().transform;
  const std::vector<cv::Point2d> spots = {
      {200.5, 210.5}, {980.5, 260.5}, {600.5, 600.5}, {333.5, 1010.5}, {990.5, 990.5}};
  constexpr double kSigma = 9;
  write_raster(folder / "a.tif", spec, [&](int column, int row) -> std::array<int, 4> {
    double value = 0;
    for (const cv::Point2d& spot : spots) {
      const double dx = column + 0.5 - spot.x, dy = row + 0.5 - spot.y;
      value = std::max(value, 250 * std::exp(-(dx * dx + dy * dy) / (2 * kSigma * kSigma)));
    }
    const int level = static_cast<int>(std::lround(value));
    return {level, level, level, 255};
  });
  RasterSource source(folder / "a.tif");
  const auto& t = *spec.transform;
  for (const cv::Point2d& spot : spots) {
    const GlobalPixel expected = pixel_by_proj(spec.epsg, t[0] + t[1] * spot.x + t[2] * spot.y,
                                               t[3] + t[4] * spot.x + t[5] * spot.y, GetParam().zoom);
    constexpr int kHalf = 60;
    const int left = static_cast<int>(expected.x) - kHalf, top = static_cast<int>(expected.y) - kHalf;
    const MaskedImage image = source.read(GetParam().zoom, {left, top, 2 * kHalf, 2 * kHalf});
    cv::Mat weight;
    cv::extractChannel(image.bgr, weight, 0);
    const cv::Moments moments = cv::moments(weight);
    EXPECT_NEAR(left + moments.m10 / moments.m00 + 0.5, expected.x, 0.1);
    EXPECT_NEAR(top + moments.m01 / moments.m00 + 0.5, expected.y, 0.1);
  }
}

TEST(RasterSource, BlocksJoinWithoutSeams) {
  const test::TemporaryFolder folder;
  RasterSpec spec;
  spec.width = spec.height = 1500;
  write_raster(folder / "a.tif", spec, [](int column, int row) -> std::array<int, 4> {
    return {(column / 8) % 256, (row / 8) % 256, (column + row) / 16 % 256, 255};
  });
  const MaskedImage whole = middle_of(folder / "a.tif", spec, 19, 1400);  // two blocks each way
  RasterSource source(folder / "a.tif");
  const auto& t = *spec.transform;
  const GlobalPixel centre = pixel_by_proj(spec.epsg, t[0] + t[1] * 750, t[3] + t[5] * 750, 19);
  const int left = static_cast<int>(centre.x) - 700, top = static_cast<int>(centre.y) - 700;
  const MaskedImage across = source.read(19, {left + 900, top + 900, 256, 256});
  EXPECT_LE(cv::norm(whole.bgr(cv::Rect(900, 900, 256, 256)), across.bgr, cv::NORM_INF), 2.0);
}

TEST(RasterSource, SupportsEveryBandLayout) {
  const test::TemporaryFolder folder;
  const auto colour_of = [&](Kind kind) {
    RasterSpec spec;
    spec.kind = kind;
    const auto path = folder / "kind.tif";
    write_raster(path, spec, plain);
    const MaskedImage image = middle_of(path, spec, 19, 64);
    EXPECT_EQ(cv::countNonZero(image.mask), 64 * 64);
    return image.bgr.at<cv::Vec3b>(30, 30);
  };
  EXPECT_EQ(colour_of(Kind::rgb), cv::Vec3b(50, 100, 200));
  EXPECT_EQ(colour_of(Kind::rgba), cv::Vec3b(50, 100, 200));
  EXPECT_EQ(colour_of(Kind::rgb_nir), cv::Vec3b(50, 100, 200));
  EXPECT_EQ(colour_of(Kind::grey), cv::Vec3b(200, 200, 200));
  EXPECT_EQ(colour_of(Kind::palette), cv::Vec3b(100, 55, 200));
}

// A hole in the western half, stated in each of the ways that there are.
class RasterHoles : public testing::TestWithParam<std::string> {};
INSTANTIATE_TEST_SUITE_P(EveryWay, RasterHoles, testing::Values("nodata", "alpha", "mask"));

TEST_P(RasterHoles, AreMaskedAndDoNotBleed) {
  const test::TemporaryFolder folder;
  RasterSpec spec;
  const auto hole = [&](int column, int) { return column < spec.width / 2; };
  if (GetParam() == "nodata") spec.nodata = 0;
  if (GetParam() == "alpha") spec.kind = Kind::rgba;
  if (GetParam() == "mask") spec.masked_out = hole;
  write_raster(folder / "a.tif", spec, [&](int column, int row) -> std::array<int, 4> {
    return hole(column, row) ? std::array<int, 4>{0, 0, 0, 0} : std::array<int, 4>{200, 100, 50, 255};
  });
  for (const int zoom : {19, 17}) {
    const MaskedImage image = middle_of(folder / "a.tif", spec, zoom, 64);
    EXPECT_EQ(image.mask.at<std::uint8_t>(32, 10), 0);
    EXPECT_EQ(image.mask.at<std::uint8_t>(32, 50), 255);
    const double valid = cv::countNonZero(image.mask) / (64.0 * 64.0);
    EXPECT_NEAR(valid, 0.5, 0.03);
    cv::Mat red;
    cv::extractChannel(image.bgr, red, 2);
    double darkest = 0;
    cv::minMaxLoc(red, &darkest, nullptr, nullptr, nullptr, image.mask);
    EXPECT_GE(darkest, 199) << "zoom " << zoom;
  }
}

// Black is a colour unless all channels are nodata.
TEST(RasterSource, NodataMeansAllColours) {
  const test::TemporaryFolder folder;
  RasterSpec spec;
  spec.nodata = 0;
  write_raster(folder / "a.tif", spec, [](int, int) -> std::array<int, 4> { return {0, 90, 0, 255}; });
  EXPECT_EQ(cv::countNonZero(middle_of(folder / "a.tif", spec, 19, 64).mask), 64 * 64);
}

TEST(RasterSource, OutsideIsNotValid) {
  const test::TemporaryFolder folder;
  const RasterSpec spec;
  write_raster(folder / "a.tif", spec, plain);
  const MaskedImage image = middle_of(folder / "a.tif", spec, 19, 1024);
  EXPECT_EQ(image.mask.at<std::uint8_t>(5, 5), 0);
  EXPECT_EQ(image.mask.at<std::uint8_t>(512, 512), 255);
  // The area on the ground must be that of the raster: 153.6 m squared.
  const double pixel_m = ground_resolution_m(19, 24.26);
  EXPECT_NEAR(cv::countNonZero(image.mask) * pixel_m * pixel_m, 153.6 * 153.6, 153.6 * 153.6 * 0.01);
  RasterSource far(folder / "a.tif");
  EXPECT_EQ(cv::countNonZero(far.read(19, {0, 0, 256, 256}).mask), 0);
}

void expect_error(const std::filesystem::path& path, const std::string& words) {
  try {
    const RasterSource source(path);
    FAIL() << "no error for " << path;
  } catch (const Error& error) {
    EXPECT_THAT(error.text().what, testing::HasSubstr(words));
    EXPECT_THAT(error.text().where, testing::HasSubstr(path.filename().string()));
    EXPECT_FALSE(error.text().fix.empty() && error.text().expected.empty());
  }
}

TEST(RasterSource, RejectsBadInputs) {
  const test::TemporaryFolder folder;
  expect_error(folder / "missing.tif", "does not exist");
  expect_error(folder.path(), "not a file");
  expect_error(folder.write("text.tif", "these are words, not pixels"), "cannot be opened");
  expect_error(folder.write("empty.tif", ""), "cannot be opened");
  RasterSpec spec;
  spec.kind = Kind::uint16;
  write_raster(folder / "deep.tif", spec, plain);
  expect_error(folder / "deep.tif", "not 8 bit");
  spec = {};
  spec.transform.reset();
  write_raster(folder / "nowhere.tif", spec, plain);
  expect_error(folder / "nowhere.tif", "not georeferenced");
  spec = {};
  spec.epsg = 0;
  write_raster(folder / "nosystem.tif", spec, plain);
  expect_error(folder / "nosystem.tif", "not georeferenced");
}

TEST(RasterSource, RejectsTruncatedFiles) {
  const test::TemporaryFolder folder;
  const RasterSpec spec;
  write_raster(folder / "a.tif", spec, plain);
  const Bytes whole = read_file(folder / "a.tif");
  int rejected = 0;
  for (const double share : {0.001, 0.1, 0.5, 0.9, 0.99}) {
    const auto path = folder / "cut.tif";
    std::ofstream(path, std::ios::binary)
        .write(as_text(whole).data(), static_cast<std::streamsize>(share * static_cast<double>(whole.size())));
    EXPECT_THROW(
        {
          RasterSource source(path);
          middle_of(path, spec, 19, 640);
        },
        Error)
        << share;
    ++rejected;
  }
  EXPECT_EQ(rejected, 5);
}

}  // namespace
}  // namespace nadir
