#include "mavlink/gps_input.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <fstream>
#include <sstream>

namespace nadir {
namespace {

constexpr std::int64_t kUnixUs = 1'730'291'696'123'456;  // 2024-10-30T12:34:56.123456Z, a Wednesday

Fix good_fix() {
  return {.unix_us = kUnixUs,
          .place = {8.5, 47.25},
          .sigma_m = 4,
          .msl_m = 600,
          .vertical_sigma_m = 6,
          .velocity = GpsVelocity{20, 1, 0},
          .speed_sigma_mps = 0.5,
          .yaw_rad = 0.0};
}

TEST(GpsTime, WeekAndMilliseconds) {
  const GpsTime time = gps_time(kUnixUs);
  // By hand: Sunday 2024-10-27 began week 2338; three days, 12:34:56.123 and 18 leap seconds are 304 514.123 s.
  EXPECT_EQ(time.week, 2338);
  EXPECT_EQ(time.week_ms, 304'514'123U);
  EXPECT_EQ(gps_time(315'964'800'000'000).week_ms, 0U);  // where it began
  EXPECT_EQ(gps_time(0).week, 0);
  EXPECT_EQ(gps_time(-5).week, 0);
}

TEST(GpsTime, ChangesWeeksEighteenSecondsBeforeSundayMidnight) {
  const std::int64_t sunday_unix_us = 1'729'987'200'000'000;  // 2024-10-27T00:00:00Z
  EXPECT_EQ(gps_time(sunday_unix_us - 18'000'000).week, 2338);
  EXPECT_EQ(gps_time(sunday_unix_us - 18'000'000).week_ms, 0U);
  EXPECT_EQ(gps_time(sunday_unix_us - 18'001'000).week, 2337);
  EXPECT_EQ(gps_time(sunday_unix_us - 18'001'000).week_ms, 604'799'999U);
}

TEST(GpsTime, UsesTheSystemsLeapSeconds) {
  std::ifstream list("/usr/share/zoneinfo/leap-seconds.list");
  if (!list) GTEST_SKIP() << "this system has no list (package tzdata)";
  constexpr std::int64_t kNtpEpochUnixS = -2'208'988'800;
  int lines = 0;
  for (std::string line; std::getline(list, line);) {
    std::int64_t ntp_s = 0;
    int tai_less_utc_s = 0;
    std::istringstream fields(line);
    if (line.starts_with('#') || !(fields >> ntp_s >> tai_less_utc_s)) continue;
    const std::int64_t unix_s = ntp_s + kNtpEpochUnixS;
    if (unix_s < 315'964'800) continue;
    ++lines;
    EXPECT_EQ(leap_seconds(unix_s), tai_less_utc_s - 19) << line;
    EXPECT_EQ(leap_seconds(unix_s - 1), tai_less_utc_s - 20) << line;
  }
  EXPECT_GE(lines, 18);
}

TEST(GpsInput, AGoodFixPassesTheAutopilotsChecks) {
  const GpsInput input = gps_input(good_fix(), 1);
  EXPECT_EQ(input.fix, GpsFix::three_d);
  EXPECT_EQ(input.gps_id, 1);
  EXPECT_EQ(input.gps_week, 2338);
  EXPECT_LE(*input.hdop, 2.5);
  EXPECT_GE(input.satellites, 6);
  EXPECT_EQ(*input.horizontal_accuracy_m, 4);
  EXPECT_EQ(*input.vertical_accuracy_m, 6);
  EXPECT_EQ(*input.speed_accuracy_mps, 1) << "0.5 is surer than a velocity that leans on the autopilot's attitude";
  EXPECT_EQ(*input.velocity, (GpsVelocity{20, 1, 0}));
  EXPECT_EQ(*input.yaw_rad, 0);
}

TEST(GpsInput, UnknownValuesStayUnknown) {
  const GpsInput input = gps_input({.unix_us = kUnixUs, .place = {8.5, 47.25}, .sigma_m = 4});
  EXPECT_EQ(input.fix, GpsFix::three_d);
  EXPECT_FALSE(input.msl_m || input.vertical_accuracy_m || input.velocity || input.speed_accuracy_mps || input.yaw_rad);
}

TEST(GpsInput, NonFiniteNumbersAreNeverSent) {
  const double none = std::nan("");
  Fix fix = good_fix();
  fix.msl_m = none;
  fix.vertical_sigma_m = none;
  fix.velocity->east_mps = none;
  fix.yaw_rad = none;
  const GpsInput input = gps_input(fix);
  EXPECT_EQ(input.fix, GpsFix::three_d);
  EXPECT_FALSE(input.msl_m || input.vertical_accuracy_m || input.velocity || input.speed_accuracy_mps || input.yaw_rad);
}

TEST(GpsInput, InvalidFixesBecomeNoFix) {
  for (int i = 0; i < 8; ++i) {
    Fix fix = good_fix();
    if (i == 0) fix.sigma_m = kMaxFixSigma_m + 0.001;
    if (i == 1) fix.sigma_m = std::nan("");
    if (i == 2) fix.sigma_m = -1;
    if (i == 3) fix.place.lat_deg = std::nan("");
    if (i == 4) fix.place.lon_deg = 181;
    if (i == 5) fix.place.lat_deg = -91;
    if (i == 6) fix.sigma_m = INFINITY;
    const GpsInput input = i == 7 ? gps_input_without_fix(kUnixUs) : gps_input(fix);
    EXPECT_EQ(input.fix, GpsFix::no_gps) << i;
    EXPECT_EQ(*input.horizontal_accuracy_m, 999) << i;
    EXPECT_EQ(input.satellites, 0) << i;
    EXPECT_FALSE(input.velocity) << i;
    EXPECT_EQ(input.gps_week, 2338) << i;
  }
}

}  // namespace
}  // namespace nadir
