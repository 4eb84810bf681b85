#include "geodesy/plane_point.hpp"

#include <gtest/gtest.h>

#include <limits>
#include <type_traits>

#include "geodesy/angles.hpp"
#include "geodesy/local_frame.hpp"

namespace nadir {
namespace {

template <typename A, typename B>
concept Addable = requires(A a, B b) {
  a + b;
};

TEST(PlanePoint, DifferencesAreDisplacements) {
  const PlanePoint a{3, -4}, b{10, 20};
  EXPECT_EQ(b - a, Eigen::Vector2d(7, 24));
  EXPECT_EQ(a + (b - a), b);
  EXPECT_EQ(b - Eigen::Vector2d(7, 24), a);
  EXPECT_EQ(distance_m(a, b), 25);
  EXPECT_EQ(PlanePoint(a.vector()), a);
  EXPECT_EQ(PlanePoint(), (PlanePoint{0, 0}));
}

TEST(PlanePoint, IsNotMistakenForADisplacement) {
  static_assert(std::is_constructible_v<PlanePoint, Eigen::Vector2d>);
  static_assert(!std::is_convertible_v<Eigen::Vector2d, PlanePoint>);
  static_assert(!std::is_convertible_v<PlanePoint, Eigen::Vector2d>);
  static_assert(Addable<PlanePoint, Eigen::Vector2d>);
  static_assert(!Addable<PlanePoint, PlanePoint>, "the sum of two positions means nothing");
  static_assert(std::is_trivially_copyable_v<PlanePoint> && sizeof(PlanePoint) == 2 * sizeof(double));
}

// What is not finite stays so: nothing hides it from those who check.
TEST(PlanePoint, NotANumberIsNotEqualToItself) {
  constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
  const PlanePoint broken{kNaN, 0};
  EXPECT_FALSE(broken == broken);
  EXPECT_TRUE(std::isnan(distance_m(broken, {})));
  EXPECT_TRUE(std::isnan((broken + Eigen::Vector2d(1, 1)).east_m));
}

// What the header says of the plane, 10 km east of its origin at 48° N.
TEST(PlanePoint, ThePlaneHasItsStatedAccuracy) {
  const LocalFrame frame({11, 48});
  EXPECT_LT(distance_m(frame.plane_from_lonlat({11, 48}), {}), 1e-9);
  const LonLat far = frame.lonlat_from_plane({10'000, 0});
  const PlanePoint back = frame.plane_from_lonlat(far);
  EXPECT_NEAR(distance_m(back, {10'000, 0}), 0.012, 0.002) << "there and back again";
  EXPECT_NEAR(frame.enu_from_geodetic({far, 0}).up_m, -8, 0.5);
  const Eigen::Vector2d north = frame.plane_from_lonlat({far.lon_deg, far.lat_deg + 1e-4}) - back;
  EXPECT_NEAR(degrees(std::atan2(north.x(), north.y())), -0.1, 0.005) << "the convergence of the meridians";
}

}  // namespace
}  // namespace nadir
