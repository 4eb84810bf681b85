#include "imagery/map_window.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "base/error.hpp"
#include "imagery/synthetic_tiles.hpp"

namespace nadir {
namespace {

constexpr LonLat kPlace{120.72, 24.26};
constexpr int kFinest = 18;

// How far the window's content is displaced, in window pixels, by least squares over each 64 x 64 block: the colours
// that are there against those that the exact transformation of each pixel's centre predicts.
double worst_displacement(const MapWindow& window, const LocalFrame& frame) {
  double worst = 0;
  const double pixels_per_column = window.gsd_m / ground_resolution_m(kFinest, frame.origin().lat_deg);
  for (int top = 0; top + 64 <= window.image.rows; top += 64) {
    for (int left = 0; left + 64 <= window.image.cols; left += 64) {
      double along[2] = {0, 0}, weight[2] = {0, 0};
      for (int row = top; row < top + 64; ++row) {
        for (int column = left; column < left + 64; ++column) {
          const PlanePoint point = window.plane_from_pixel(column + 0.5, row + 0.5);
          const GlobalPixel place = pixel_from_lonlat(frame.lonlat_from_plane(point), kFinest);
          const double at[2] = {place.x, place.y};
          const cv::Vec3b& colour = window.image.at<cv::Vec3b>(row, column);
          for (int axis = 0; axis < 2; ++axis) {
            const double slope = test::WaveTiles::slope(at[axis]) * pixels_per_column;
            along[axis] += (colour[axis] - test::WaveTiles::wave(at[axis])) * slope;
            weight[axis] += slope * slope;
          }
        }
      }
      for (int axis = 0; axis < 2; ++axis) worst = std::max(worst, std::abs(along[axis] / weight[axis]));
    }
  }
  return worst;
}

struct Scale {
  double relative_gsd;  // to a pixel of the finest zoom
  ZoomRange zooms;
};

class MapWindowPlaces : public testing::TestWithParam<Scale> {};
INSTANTIATE_TEST_SUITE_P(AtAnyScale, MapWindowPlaces,
                         testing::Values(Scale{0.6, {15, 18}}, Scale{1.0, {15, 18}}, Scale{1.7, {15, 18}},
                                         Scale{3.3, {15, 18}}, Scale{5.3, {18, 18}}, Scale{2.0, {18, 18}}));

TEST_P(MapWindowPlaces, AreAccurateToATwentiethOfAPixel) {
  const test::WaveTiles tiles(GetParam().zooms, kFinest);
  // Away from the frame's origin the map is turned and scaled against it.
  const LocalFrame frame({kPlace.lon_deg + 0.03, kPlace.lat_deg - 0.04});
  const double gsd_m = GetParam().relative_gsd * ground_resolution_m(kFinest, kPlace.lat_deg);
  const PlanePoint centre = frame.plane_from_lonlat(kPlace);
  const double half = 160.0 * gsd_m;
  const MapWindow window = read_map_window(
      tiles, frame, {centre.east_m - half, centre.north_m - half, centre.east_m + half, centre.north_m + half}, gsd_m,
      Colour::bgr);
  ASSERT_EQ(window.image.size(), cv::Size(320, 320));
  EXPECT_EQ(cv::countNonZero(window.mask), 320 * 320);
  EXPECT_LT(worst_displacement(window, frame), 0.05);
}

TEST(MapWindow, LargeWindowsHaveNoSeams) {
  const test::WaveTiles tiles({15, 18}, kFinest);
  const LocalFrame frame(kPlace);
  const double gsd_m = ground_resolution_m(kFinest, kPlace.lat_deg) * 1.01;
  const MapWindow window =
      read_map_window(tiles, frame, {-900 * gsd_m, -600 * gsd_m, 900 * gsd_m, 600 * gsd_m}, gsd_m, Colour::bgr);
  ASSERT_EQ(window.image.size(), cv::Size(1800, 1200));
  EXPECT_LT(worst_displacement(window, frame), 0.05);
}

TEST(MapWindow, UsesTheCoarsestSufficientZoom) {
  const test::WaveTiles tiles({15, 18}, kFinest);
  const LocalFrame frame(kPlace);
  const auto zoom_at = [&](double gsd_m) {
    const MapWindow window = read_map_window(tiles, frame, {0, 0, 20 * gsd_m, 20 * gsd_m}, gsd_m, Colour::bgr);
    return window.image.at<cv::Vec3b>(10, 10)[2] / 10;  // red encodes the zoom
  };
  EXPECT_EQ(zoom_at(ground_resolution_m(18, kPlace.lat_deg) / 3), 18);
  EXPECT_EQ(zoom_at(ground_resolution_m(18, kPlace.lat_deg)), 18);
  EXPECT_EQ(zoom_at(ground_resolution_m(17, kPlace.lat_deg) * 0.95), 18);
  EXPECT_EQ(zoom_at(ground_resolution_m(17, kPlace.lat_deg)), 17);
  EXPECT_EQ(zoom_at(ground_resolution_m(15, kPlace.lat_deg) * 9), 15);
}

TEST(MapWindow, MasksWhatIsMissing) {
  test::WaveTiles tiles({18, 18}, kFinest);
  const TileKey centre = tile_at(kPlace, kFinest);
  tiles.missing = [&](const TileKey& key) { return key.x > centre.x; };
  const LonLatBox bounds = bounds_of(centre);
  const LocalFrame frame({bounds.east_deg, kPlace.lat_deg});  // what lies east of 0 is missing
  const double gsd_m = ground_resolution_m(kFinest, kPlace.lat_deg);
  const MapWindow window =
      read_map_window(tiles, frame, {-50 * gsd_m, -50 * gsd_m, 50 * gsd_m, 50 * gsd_m}, gsd_m, Colour::grey);
  EXPECT_EQ(window.image.type(), CV_8UC1);
  EXPECT_EQ(window.mask.at<std::uint8_t>(50, 48), 255);
  EXPECT_EQ(window.mask.at<std::uint8_t>(50, 51), 0);
  const int valid = cv::countNonZero(window.mask.row(20));
  EXPECT_GE(valid, 49);
  EXPECT_LE(valid, 50);
}

TEST(MapWindow, AppliesTheMasksOfTheTiles) {
  test::WaveTiles tiles({18, 18}, kFinest);
  cv::Mat half(kTileSize, kTileSize, CV_8UC1, cv::Scalar(255));
  half.rowRange(0, kTileSize / 2).setTo(0);  // the north shows no ground
  tiles.mask = [&](const TileKey&) { return encode_image(half, ImageFormat::png); };
  const LonLatBox bounds = bounds_of(tile_at(kPlace, kFinest));
  const LocalFrame frame({(bounds.west_deg + bounds.east_deg) / 2, (bounds.south_deg + bounds.north_deg) / 2});
  for (const double factor : {1.0, 4.0}) {
    const double gsd_m = ground_resolution_m(kFinest, kPlace.lat_deg) * factor;
    const double side = 100.0 / factor;
    const MapWindow window =
        read_map_window(tiles, frame, {-side * gsd_m, -20 * gsd_m, side * gsd_m, 20 * gsd_m}, gsd_m, Colour::grey);
    EXPECT_EQ(cv::countNonZero(window.mask.rowRange(0, 19)), 0) << factor;
    EXPECT_EQ(cv::countNonZero(window.mask.rowRange(21, 30)), window.mask.cols * 9) << factor;
  }
}

// The mask is only sampled where tiles with masks, or the edges of the map, lie; and no pixel where there is no tile.
TEST(MapWindow, IsTheSameFromTilesWithoutMasksAndWithMasksThatHideNothingOfIt) {
  const TileKey south_east = tile_at(kPlace, kFinest);
  const LonLatBox bounds = bounds_of(south_east);
  const LocalFrame frame({bounds.west_deg, bounds.north_deg});  // four tiles meet
  const auto is_missing = [&](const TileKey& key) { return key.x < south_east.x && key.y < south_east.y; };
  test::WaveTiles whole({18, 18}, kFinest), masked({18, 18}, kFinest);
  whole.missing = is_missing;
  masked.mask = [&](const TileKey& key) {
    cv::Mat mask(kTileSize, kTileSize, CV_8UC1, cv::Scalar(is_missing(key) ? 0 : 255));
    mask.at<std::uint8_t>(kTileSize / 2, kTileSize / 2) = 0;  // beyond the window
    return encode_image(mask, ImageFormat::png);
  };
  for (const double factor : {1.0, 1.4, 3.0}) {
    for (const Colour colour : {Colour::grey, Colour::bgr}) {
      const double gsd_m = ground_resolution_m(kFinest, kPlace.lat_deg) * factor;
      const double side_m = 110 * gsd_m / factor;
      const PlaneBox box{-side_m, -side_m, side_m, side_m};
      const MapWindow one = read_map_window(whole, frame, box, gsd_m, colour);
      MapWindow other = read_map_window(masked, frame, box, gsd_m, colour);
      EXPECT_GT(cv::countNonZero(one.mask), 0.7 * static_cast<double>(one.mask.total()));
      EXPECT_LT(cv::countNonZero(one.mask), 0.8 * static_cast<double>(one.mask.total()));
      EXPECT_EQ(cv::norm(one.mask, other.mask, cv::NORM_INF), 0.0) << factor;
      cv::Mat seen;
      one.image.copyTo(seen, one.mask);
      other.image.setTo(cv::Scalar::all(0), other.mask == 0);
      EXPECT_EQ(cv::norm(seen, other.image, cv::NORM_INF), 0.0) << factor;
    }
  }
}

TEST(MapWindow, NeighboursShareDecodedTiles) {
  const test::WaveTiles tiles({18, 18}, kFinest);
  const LocalFrame frame(kPlace);
  const double gsd_m = ground_resolution_m(kFinest, kPlace.lat_deg);
  MapWindowReader reader(tiles);
  const PlaneBox box{-300 * gsd_m, -300 * gsd_m, 300 * gsd_m, 300 * gsd_m};
  const MapWindow first = reader.read(frame, box, gsd_m, Colour::grey);
  const auto reads = tiles.reads;
  const MapWindow second = reader.read(frame, box, gsd_m, Colour::grey);
  EXPECT_EQ(tiles.reads, reads);
  EXPECT_EQ(cv::norm(first.image, second.image, cv::NORM_INF), 0.0);
}

TEST(MapWindow, RejectsImpossibleWindows) {
  const test::WaveTiles tiles({18, 18}, kFinest);
  const LocalFrame frame(kPlace);
  EXPECT_THROW(read_map_window(tiles, frame, {0, 0, 10, 10}, 0, Colour::grey), Error);
  EXPECT_THROW(read_map_window(tiles, frame, {0, 0, 10, 10}, -1, Colour::grey), Error);
  EXPECT_THROW(read_map_window(tiles, frame, {0, 0, 10, 10}, std::nan(""), Colour::grey), Error);
  EXPECT_THROW(read_map_window(tiles, frame, {10, 0, 0, 10}, 1, Colour::grey), Error);
  EXPECT_THROW(read_map_window(tiles, frame, {0, 0, 1e6, 10}, 1, Colour::grey), Error);
}

// One coarse scene does not affect the others.
TEST(MapWindow, StatesTheWorstPlacementOfItsOwnTiles) {
  test::WaveTiles tiles({17, 18}, kFinest);
  const TileKey here = tile_at(kPlace, 18);
  tiles.ce90 = [here](const TileKey& key) -> std::optional<double> {
    const std::uint32_t column = key.z == 18 ? key.x : key.x * 2;
    return column < here.x + 2 ? 4.0 : 20.0;
  };
  const LocalFrame frame(kPlace);
  MapWindowReader reader(tiles);
  const double tile_m = 256 * ground_resolution_m(18, kPlace.lat_deg), gsd_m = ground_resolution_m(18, kPlace.lat_deg);
  const PlaneBox west{-tile_m / 4, -tile_m / 4, tile_m / 4, tile_m / 4};
  EXPECT_EQ(reader.ce90_m(frame, west, gsd_m), 4.0);
  EXPECT_EQ(reader.read(frame, west, gsd_m, Colour::grey).ce90_m, 4.0);
  const PlaneBox both{-tile_m / 4, -tile_m / 4, 4 * tile_m, tile_m / 4};
  EXPECT_EQ(reader.ce90_m(frame, both, gsd_m), 20.0);
  EXPECT_EQ(reader.read(frame, both, gsd_m, Colour::grey).ce90_m, 20.0);
  EXPECT_EQ(reader.read(frame, west, gsd_m, Colour::grey).ce90_m, 4.0) << "of this window, not of the last";
  tiles.ce90 = nullptr;
  EXPECT_FALSE(reader.ce90_m(frame, both, gsd_m));
  EXPECT_FALSE(reader.read(frame, both, gsd_m, Colour::grey).ce90_m);
}

}  // namespace
}  // namespace nadir
