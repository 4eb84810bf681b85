#include "estimation/terrain_surface.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "base/random.hpp"

namespace nadir {
namespace {

constexpr LonLat kTakeoff{11, 48};

// Hills over 20 km, so that the curvature of the Earth in the plane shows where it is forgotten.
TerrainRaster hills(const std::function<bool(int, int)>& hole = [](int, int) { return false; }) {
  const TerrainGrid grid{10.85, 48.1, 0.0003, 0.0002, 1000, 1000};
  std::vector<float> heights;
  for (int row = 0; row < grid.rows; ++row) {
    for (int column = 0; column < grid.columns; ++column) {
      const double height = 600 + 80 * std::sin(column * 0.02) + 60 * std::cos(row * 0.03);
      heights.push_back(hole(column, row) ? std::numeric_limits<float>::quiet_NaN() : static_cast<float>(height));
    }
  }
  return {grid, std::move(heights)};
}

TEST(Terrain, InThePlaneIsTheRasterAtTheSamePlace) {
  const TerrainRaster raster = hills();
  const LocalFrame frame(kTakeoff, 550);
  const TerrainSurface surface(raster, frame, 550);
  Random random(5);
  for (int i = 0; i < 500; ++i) {
    const PlanePoint point{random.uniform(-10'500, 10'500), random.uniform(-10'500, 10'500)};
    const auto expected = raster.height_m(frame.lonlat_from_plane(point));
    ASSERT_TRUE(expected);
    EXPECT_NEAR(surface.height_m(point), *expected - 550, 0.01);
  }
  EXPECT_GT(surface.relief_sigma_m(), 0);
}

TEST(Terrain, BeyondTheRasterContinuesAtItsEdge) {
  const TerrainRaster raster = hills();
  const LocalFrame frame(kTakeoff);
  const TerrainSurface surface(raster, frame);
  const PlanePoint edge = frame.plane_from_lonlat(raster.grid().place(999, 500));
  EXPECT_NEAR(surface.height_m({edge.east_m + 4000, edge.north_m}), surface.height_m({edge.east_m, edge.north_m}), 1.0);
  for (const double far : {-1e7, 1e7, std::numeric_limits<double>::infinity(), std::nan("")}) {
    EXPECT_TRUE(std::isfinite(surface.height_m({far, far})));
    EXPECT_TRUE(std::isfinite(surface.height_m({0, far})));
  }
}

TEST(Terrain, HolesTakeTheHeightOfTheirRim) {
  const auto hole = [](int column, int row) { return std::hypot(column - 500, row - 500) < 10; };
  const TerrainRaster whole = hills(), holed = hills(hole);
  const LocalFrame frame(kTakeoff);
  const TerrainSurface truth(whole, frame), surface(holed, frame);
  const PlanePoint middle = frame.plane_from_lonlat(whole.grid().place(500, 500));
  EXPECT_NEAR(surface.height_m({middle.east_m, middle.north_m}), truth.height_m({middle.east_m, middle.north_m}), 30);
  EXPECT_DOUBLE_EQ(surface.height_m({middle.east_m + 1000, middle.north_m}),
                   truth.height_m({middle.east_m + 1000, middle.north_m}));
  const TerrainRaster nothing = hills([](int, int) { return true; });
  EXPECT_EQ(TerrainSurface(nothing, frame).height_m({0, 0}), 0);
}

TEST(Terrain, OfOnePostIsFlat) {
  const TerrainRaster raster({11, 48, 0.001, 0.001, 1, 1}, {123});
  const TerrainSurface surface(raster, LocalFrame(kTakeoff));
  EXPECT_EQ(surface.height_m({0, 0}), 123);
  EXPECT_EQ(surface.height_m({-500, 900}), 123);
}

}  // namespace
}  // namespace nadir
