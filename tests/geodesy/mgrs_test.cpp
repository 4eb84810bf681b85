// Grid references as operators write them. PROJ has none, but its UTM gives the digits: easting 322821.37 m and northing
// 4306997.60 m in zone 18 for 77.043° W, 38.894° N.
#include "geodesy/mgrs.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "geodesy/local_frame.hpp"

namespace nadir {
namespace {

double apart_m(LonLat a, LonLat b) {
  const PlanePoint p = LocalFrame(a).plane_from_lonlat(b);
  return std::hypot(p.east_m, p.north_m);
}

TEST(Mgrs, IsWrittenAsItIsSpoken) {
  EXPECT_EQ(mgrs_from_lonlat({-77.043, 38.894}), "18S UJ 22821 06997");
  EXPECT_EQ(mgrs_from_lonlat({14.0249894, 48.7883274}).substr(0, 6), "33U VQ");
  EXPECT_EQ(mgrs_from_lonlat({0, 90}).substr(0, 1), "Z") << "the pole has no zone";
}

TEST(Mgrs, ComesBackFromWhatWasWritten) {
  for (const LonLat place : {LonLat{-77.043, 38.894}, LonLat{14.02, 48.79}, LonLat{-179.99, -45}, LonLat{6, 60},
                             LonLat{20, 79}, LonLat{151.2, -33.9}, LonLat{10, 89.5}, LonLat{0, -85}}) {
    const auto again = lonlat_from_mgrs(mgrs_from_lonlat(place));
    ASSERT_TRUE(again) << place.lon_deg;
    EXPECT_LT(apart_m(place, *again), 0.75) << place.lon_deg;  // half a diagonal of the square
  }
}

TEST(Mgrs, IsReadInAnySpelling) {
  const auto whole = lonlat_from_mgrs("18SUJ2282106997");
  ASSERT_TRUE(whole);
  EXPECT_LT(apart_m(*whole, {-77.043, 38.894}), 1);
  for (const char* text : {"18S UJ 22821 06997", "18suj 2282106997", " 18SUJ22821 06997 "}) {
    const auto read = lonlat_from_mgrs(text);
    ASSERT_TRUE(read) << text;
    EXPECT_LT(apart_m(*whole, *read), 1e-6) << text;
  }
  const auto hundred_m = lonlat_from_mgrs("18SUJ228069");
  ASSERT_TRUE(hundred_m);
  EXPECT_LT(apart_m(*whole, *hundred_m), 71) << "the middle of the square";
}

TEST(Mgrs, WhatIsNoPositionIsRefused) {
  for (const char* text :
       {"", " ", "18SUJ", "18SUJ20", "18SUJ2282106", "18SUJ228210699", "99SUJ2282106997", "18IUJ2282106997",
        "18SUJ2282106997X", "INVALID", "120.72,24.26", "18SZZ2282106997", "18S;UJ"}) {
    EXPECT_FALSE(lonlat_from_mgrs(text)) << text;
  }
  EXPECT_FALSE(lonlat_from_mgrs(std::string(100'000, '1')));
  EXPECT_EQ(mgrs_from_lonlat({0, 91}) + mgrs_from_lonlat({std::numeric_limits<double>::quiet_NaN(), 0}), "");
  EXPECT_FALSE(lonlat_from_mgrs(std::string(15, '\0')));
}

}  // namespace
}  // namespace nadir
