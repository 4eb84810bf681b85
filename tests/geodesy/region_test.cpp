#include "geodesy/region.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

namespace nadir {
namespace {

const PlaneRing kSquare{{0, 0}, {10, 0}, {10, 10}, {0, 10}};
const PlaneRing kHook{{0, 0}, {30, 0}, {30, 30}, {20, 30}, {20, 10}, {10, 10}, {10, 30}, {0, 30}};

TEST(Region, AreaIsSigned) {
  EXPECT_DOUBLE_EQ(area_m2(kSquare), 100);
  PlaneRing clockwise = kSquare;
  std::reverse(clockwise.begin(), clockwise.end());
  EXPECT_DOUBLE_EQ(area_m2(clockwise), -100);
  EXPECT_DOUBLE_EQ(area_m2(kHook), 700);
}

TEST(Region, ContainsPointsOfAConcaveRing) {
  EXPECT_TRUE(contains(kHook, {5, 20}));
  EXPECT_FALSE(contains(kHook, {15, 20}));
  EXPECT_TRUE(contains(kHook, {15, 5}));
  EXPECT_FALSE(contains(kHook, {-1, 5}));
}

// Counting grid points is the brute-force oracle of the area.
TEST(Region, ContainsAgreesWithTheArea) {
  int inside = 0;
  for (int x = 0; x < 320; ++x) {
    for (int y = 0; y < 320; ++y) inside += contains(kHook, {x * 0.1 - 0.95, y * 0.1 - 0.95});
  }
  EXPECT_NEAR(inside * 0.01, 700, 1);
}

TEST(Region, DetectsSelfIntersectingRings) {
  EXPECT_FALSE(self_intersects(kSquare));
  EXPECT_FALSE(self_intersects(kHook));
  EXPECT_TRUE(self_intersects({{0, 0}, {10, 10}, {10, 0}, {0, 10}}));
}

TEST(Region, DistanceToAPathIsTheNearestSampledPoint) {
  const PlanePath path{{0, 0}, {100, 0}, {100, 50}};
  EXPECT_DOUBLE_EQ(length_m(path), 150);
  for (const PlanePoint p : {PlanePoint{50, 7}, {-3, -4}, {120, 20}, {103, 54}, {70, 30}}) {
    double nearest = 1e9;
    for (int i = 0; i <= 150'000; ++i) {
      const double s = i / 1000.0;
      const double x = std::min(s, 100.0), y = std::max(0.0, s - 100);
      nearest = std::min(nearest, std::hypot(x - p.east_m, y - p.north_m));
    }
    EXPECT_NEAR(distance_to_path_m(path, p), nearest, 1e-3);
  }
}

TEST(Region, IsTheUnionOfRingsAndCorridors) {
  const Region region{{kSquare}, {{{{20, 0}, {40, 0}}, 5}}};
  EXPECT_TRUE(region.contains({5, 5}));
  EXPECT_TRUE(region.contains({30, 4.9}));
  EXPECT_TRUE(region.contains({44.9, 0}));  // the round cap
  EXPECT_FALSE(region.contains({44, 4}));
  EXPECT_FALSE(region.contains({12, 5}));
  const PlaneBox box = region.bounds();
  EXPECT_LE(box.west_m, 0);
  EXPECT_GE(box.east_m, 45);
  EXPECT_LE(box.south_m, -5);
  EXPECT_GE(box.north_m, 10);
}

}  // namespace
}  // namespace nadir
