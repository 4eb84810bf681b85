#include "service/gps_health.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "geodesy/local_frame.hpp"

namespace nadir {
namespace {

LonLat east_by(double metres) { return LocalFrame({14.0, 48.8}).lonlat_from_enu(metres, 0); }

TEST(GpsHints, TheFirstPlaceIsToldEvenWhenThePositionIsKnown) {
  GpsHints hints;
  EXPECT_TRUE(hints.due(east_by(0), true));
  EXPECT_FALSE(hints.due(east_by(0), true));
}

TEST(GpsHints, WhoTookOffWithoutAPositionIsToldAgainWhereTheyAre) {
  GpsHints hints;
  int told = 0;
  for (double metres = 0; metres <= 960; metres += 40) told += hints.due(east_by(metres), false);
  EXPECT_EQ(told, 13) << "every 80 m: 40 are too little";
}

TEST(GpsHints, WhoKnowsThePositionOrStandsStillIsNotTold) {
  GpsHints hints;
  hints.due(east_by(0), false);
  EXPECT_FALSE(hints.due(east_by(500), true));
  EXPECT_FALSE(hints.due(east_by(60), false));
  EXPECT_TRUE(hints.due(east_by(500), false)) << "lost again";
  EXPECT_FALSE(hints.due({std::nan(""), 48.8}, false));
}

}  // namespace
}  // namespace nadir
