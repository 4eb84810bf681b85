#include "mavlink/gps_input.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <iterator>

namespace nadir {
namespace {

constexpr std::int64_t kGpsEpochUnix_s = 315'964'800;  // 1980-01-06T00:00:00Z
constexpr std::int64_t kWeek_ms = 7 * 86'400'000LL;

// Unix times at which a leap second takes effect (IERS Bulletin C); the last one is 2017-01-01. A test compares them
// with the system's list, which is updated.
constexpr std::array<std::int64_t, 18> kLeapSeconds{
    362793600, 394329600, 425865600, 489024000, 567993600,  631152000,  662688000,  709948800,  741484800,
    773020800, 820454400, 867715200, 915148800, 1136073600, 1230768000, 1341100800, 1435708800, 1483228800};

// There are no satellites and no dilution of precision: values that pass the autopilot's checks (2.5 and 6), so that
// the accuracies, which are real, decide.
constexpr double kHdop = 1.0;
constexpr double kVdop = 1.5;
constexpr int kSatellites = 10;

constexpr double kAccuracyWithoutFix_m = 999.0;

// Our velocity depends on the autopilot's attitude. With an overconfident velocity the filter tilts its attitude, which
// feeds back. A larger value would fail its checks before first use.
constexpr double kMinSpeedSigma_mps = 1.0;

bool usable(double sigma) { return std::isfinite(sigma) && sigma >= 0; }

bool usable(const Fix& fix) {
  return usable(fix.sigma_m) && fix.sigma_m <= kMaxFixSigma_m && std::abs(fix.place.lat_deg) <= 90 &&
         std::abs(fix.place.lon_deg) <= 180;
}

bool finite(const GpsVelocity& v) {
  return std::isfinite(v.north_mps) && std::isfinite(v.east_mps) && std::isfinite(v.down_mps.value_or(0));
}

GpsInput timed(std::int64_t unix_us, std::uint8_t gps_id) {
  GpsInput input;
  const GpsTime time = gps_time(unix_us);
  input.unix_us = unix_us;
  input.gps_week = time.week;
  input.gps_week_ms = time.week_ms;
  input.gps_id = gps_id;
  return input;
}

}  // namespace
int leap_seconds(std::int64_t unix_s) {
  return static_cast<int>(
      std::distance(kLeapSeconds.begin(), std::upper_bound(kLeapSeconds.begin(), kLeapSeconds.end(), unix_s)));
}

GpsTime gps_time(std::int64_t unix_us) {
  const std::int64_t unix_s = unix_us / 1'000'000;
  if (unix_s < kGpsEpochUnix_s) return {};
  const std::int64_t gps_ms = unix_us / 1000 - kGpsEpochUnix_s * 1000 + leap_seconds(unix_s) * 1000LL;
  return {static_cast<std::uint16_t>(gps_ms / kWeek_ms), static_cast<std::uint32_t>(gps_ms % kWeek_ms)};
}

GpsInput gps_input_without_fix(std::int64_t unix_us, std::uint8_t gps_id) {
  GpsInput input = timed(unix_us, gps_id);
  input.fix = GpsFix::no_gps;
  input.horizontal_accuracy_m = kAccuracyWithoutFix_m;
  return input;
}

GpsInput gps_input(const Fix& fix, std::uint8_t gps_id) {
  if (!usable(fix)) return gps_input_without_fix(fix.unix_us, gps_id);
  GpsInput input = timed(fix.unix_us, gps_id);
  input.fix = GpsFix::three_d;  // the autopilot's filter requires it, whether or not the height is known
  input.place = fix.place;
  input.hdop = kHdop;
  input.vdop = kVdop;
  input.satellites = kSatellites;
  input.horizontal_accuracy_m = fix.sigma_m;
  if (fix.msl_m && std::isfinite(*fix.msl_m)) input.msl_m = fix.msl_m;
  if (fix.vertical_sigma_m && usable(*fix.vertical_sigma_m)) input.vertical_accuracy_m = fix.vertical_sigma_m;
  if (fix.velocity && finite(*fix.velocity)) {
    input.velocity = fix.velocity;
    if (fix.speed_sigma_mps && usable(*fix.speed_sigma_mps)) {
      input.speed_accuracy_mps = std::max(*fix.speed_sigma_mps, kMinSpeedSigma_mps);
    }
  }
  if (fix.yaw_rad && std::isfinite(*fix.yaw_rad)) input.yaw_rad = fix.yaw_rad;
  return input;
}

}  // namespace nadir
