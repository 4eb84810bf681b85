#include "geodesy/local_frame.hpp"

#include <gtest/gtest.h>

#include <GeographicLib/LocalCartesian.hpp>
#include <algorithm>
#include <cmath>
#include <random>

namespace nadir {
namespace {

// GeographicLib's manual of CartConvert: echo 33.3 44.4 6000 | CartConvert -l 33 44 20 gives 37288.97 33374.29 5783.65.
TEST(LocalFrame, MatchesTheExampleOfGeographicLib) {
  const LocalFrame frame({44, 33}, 20);
  const Enu enu = frame.enu_from_geodetic({{44.4, 33.3}, 6000});
  EXPECT_NEAR(enu.east_m, 37288.97, 0.006);
  EXPECT_NEAR(enu.north_m, 33374.29, 0.006);
  EXPECT_NEAR(enu.up_m, 5783.65, 0.006);
}

// The second example: echo 37288.97 33374.29 5783.65 | CartConvert -l 33 44 20 -r gives 33.3 44.4 6000.
TEST(LocalFrame, MatchesTheExampleOfGeographicLibReversed) {
  const Geodetic point = LocalFrame({44, 33}, 20).geodetic_from_enu({37288.97, 33374.29, 5783.65});
  EXPECT_NEAR(point.place.lat_deg, 33.3, 1e-7);
  EXPECT_NEAR(point.place.lon_deg, 44.4, 1e-7);
  EXPECT_NEAR(point.height_m, 6000, 0.01);
}

// An independent derivation: straight from the ellipsoid's equations (WGS84).
TEST(LocalFrame, AgreesWithTheEllipsoidsEquations) {
  constexpr double kA = 6378137.0, kF = 1 / 298.257223563, kE2 = kF * (2 - kF), kDeg = M_PI / 180;
  const auto cartesian = [&](double lon, double lat, double h) {
    const double n = kA / std::sqrt(1 - kE2 * std::sin(lat) * std::sin(lat));
    return std::array{(n + h) * std::cos(lat) * std::cos(lon), (n + h) * std::cos(lat) * std::sin(lon),
                      (n * (1 - kE2) + h) * std::sin(lat)};
  };
  const double lon0 = 120.72, lat0 = 24.26;
  const LocalFrame frame({lon0, lat0});
  for (const auto& [dlon, dlat] : {std::pair{0.01, 0.0}, {0.0, 0.02}, {-0.03, -0.01}}) {
    const auto o = cartesian(lon0 * kDeg, lat0 * kDeg, 0), p = cartesian((lon0 + dlon) * kDeg, (lat0 + dlat) * kDeg, 0);
    const double dx = p[0] - o[0], dy = p[1] - o[1], dz = p[2] - o[2];
    const double sl = std::sin(lon0 * kDeg), cl = std::cos(lon0 * kDeg), sp = std::sin(lat0 * kDeg),
                 cp = std::cos(lat0 * kDeg);
    const PlanePoint enu = frame.plane_from_lonlat({lon0 + dlon, lat0 + dlat});
    EXPECT_NEAR(enu.east_m, -sl * dx + cl * dy, 1e-6);
    EXPECT_NEAR(enu.north_m, -sp * cl * dx - sp * sl * dy + cp * dz, 1e-6);
  }
}

// All over the world, from below the ground to the height of satellites: 6e-9 m, the last bits of an earth's radius.
TEST(LocalFrame, AgreesWithGeographicLib) {
  std::mt19937_64 engine(1);
  const auto draw = [&](double low, double high) {
    return low + (high - low) * static_cast<double>(engine() >> 11) * 0x1p-53;
  };
  double furthest_m = 0;
  for (int i = 0; i < 20000; ++i) {
    const double lat_deg = draw(-89.9, 89.9), lon_deg = draw(-180, 180), height_m = draw(0, 3000);
    const Enu at{draw(-1e5, 1e5), draw(-1e5, 1e5), draw(-3000, 1e6)};
    const LocalFrame frame({lon_deg, lat_deg}, height_m);
    const GeographicLib::LocalCartesian oracle(lat_deg, lon_deg, height_m);
    double lat, lon, height, east, north, up;
    oracle.Reverse(at.east_m, at.north_m, at.up_m, lat, lon, height);
    const Geodetic found = frame.geodetic_from_enu(at);
    const double turn_deg = std::remainder(found.place.lon_deg - lon, 360.0);
    oracle.Forward(lat, lon, height, east, north, up);
    const Enu back = frame.enu_from_geodetic({{lon, lat}, height});
    furthest_m = std::max({furthest_m, std::abs(found.place.lat_deg - lat) * 111e3,
                           std::abs(turn_deg) * 111e3 * std::cos(lat * M_PI / 180), std::abs(found.height_m - height),
                           std::abs(back.east_m - east), std::abs(back.north_m - north), std::abs(back.up_m - up)});
  }
  EXPECT_LT(furthest_m, 1e-8);
}

TEST(LocalFrame, KnowsThePoles) {
  const LocalFrame frame({0, 90}, 0);
  const Geodetic pole = frame.geodetic_from_enu({0, 0, 100});
  EXPECT_NEAR(pole.place.lat_deg, 90, 1e-9);
  EXPECT_NEAR(pole.height_m, 100, 1e-6);
}

TEST(LocalFrame, RoundTrips) {
  const LocalFrame frame({-83.3, 41.03}, 200);
  for (const double east : {-12000.0, 0.0, 900.0}) {
    for (const double north : {-500.0, 0.0, 15000.0}) {
      const LonLat place = frame.lonlat_from_plane({east, north});
      const PlanePoint back = frame.plane_from_lonlat(place);
      // A place carries no height: 15 km out, the ground has dropped 18 m below the plane.
      EXPECT_NEAR(back.east_m, east, 0.1);
      EXPECT_NEAR(back.north_m, north, 0.1);
    }
  }
}

TEST(LocalFrame, CopiesAreIndependent) {
  const LocalFrame a({10, 50});
  LocalFrame b({0, 0});
  b = a;
  EXPECT_EQ(b.origin(), a.origin());
  EXPECT_EQ(b.plane_from_lonlat({10.01, 50}).east_m, a.plane_from_lonlat({10.01, 50}).east_m);
}

}  // namespace
}  // namespace nadir
