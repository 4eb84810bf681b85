#include "api/flight_view.hpp"

#include <gtest/gtest.h>

namespace nadir {
namespace {

TEST(EventRing, KeepsTheLastOnesAndCountsOn) {
  EventRing ring(3);
  for (int i = 1; i <= 5; ++i) ring.add(i, EventSeverity::info, "state", std::to_string(i));
  ASSERT_EQ(ring.events().size(), 3U);
  EXPECT_EQ(ring.events().front().id, 3U);
  EXPECT_EQ(ring.events().back().id, 5U);
  EXPECT_EQ(ring.events().back().text, "5");
}

TEST(FlightTrail, ThinsAndForgets) {
  FlightTrail trail(10, 1);
  for (int i = 0; i <= 240; ++i) {
    TrackPoint point;
    point.time_s = i * 0.125;
    trail.add(point);
  }
  ASSERT_EQ(trail.points().size(), 11U);
  EXPECT_NEAR(trail.points().front().time_s, 20, 1e-9);
  EXPECT_NEAR(trail.points().back().time_s, 30, 1e-9);
  for (std::size_t i = 1; i < trail.points().size(); ++i) {
    EXPECT_GE(trail.points()[i].time_s - trail.points()[i - 1].time_s, 1 - 1e-9);
  }
}

}  // namespace
}  // namespace nadir
