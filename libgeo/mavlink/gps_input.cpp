#include "mavlink/gps_input.hpp"

#include <algorithm>
#include <cmath>

#include "mavlink/gps_time.hpp"

namespace nadir {
namespace {

// There are no satellites and no dilution: numbers that pass the autopilot's checks (2.5 and 6), so that the
// accuracies, which are true, decide.
constexpr double kHdop = 1.0;
constexpr double kVdop = 1.5;
constexpr int kSatellites = 10;

constexpr double kNoFixAccuracyM = 999.0;

// Our velocity leans on the autopilot's attitude, and a filter that is told too sure a velocity tilts its attitude by
// it, and so on. More than this its checks before the first use do not let pass.
constexpr double kLeastSpeedSigma_m_s = 1.0;

bool usable(double sigma) { return std::isfinite(sigma) && sigma >= 0; }

bool usable(const Fix& fix) {
  return usable(fix.sigma_m) && fix.sigma_m <= kMaxFixSigmaM && std::abs(fix.place.lat_deg) <= 90 &&
         std::abs(fix.place.lon_deg) <= 180;
}

bool finite(const GpsVelocity& v) {
  return std::isfinite(v.north_m_s) && std::isfinite(v.east_m_s) && std::isfinite(v.down_m_s.value_or(0));
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

GpsInput gps_input_without_fix(std::int64_t unix_us, std::uint8_t gps_id) {
  GpsInput input = timed(unix_us, gps_id);
  input.fix = GpsFix::no_gps;
  input.horizontal_accuracy_m = kNoFixAccuracyM;
  return input;
}

GpsInput gps_input(const Fix& fix, std::uint8_t gps_id) {
  if (!usable(fix)) return gps_input_without_fix(fix.unix_us, gps_id);
  GpsInput input = timed(fix.unix_us, gps_id);
  input.fix = GpsFix::three_d;  // the autopilot's filter takes nothing less, whether or not we know the height
  input.place = fix.place;
  input.hdop = kHdop;
  input.vdop = kVdop;
  input.satellites = kSatellites;
  input.horizontal_accuracy_m = fix.sigma_m;
  if (fix.msl_m && std::isfinite(*fix.msl_m)) input.msl_m = fix.msl_m;
  if (fix.vertical_sigma_m && usable(*fix.vertical_sigma_m)) input.vertical_accuracy_m = fix.vertical_sigma_m;
  if (fix.velocity && finite(*fix.velocity)) {
    input.velocity = fix.velocity;
    if (fix.speed_sigma_m_s && usable(*fix.speed_sigma_m_s)) {
      input.speed_accuracy_m_s = std::max(*fix.speed_sigma_m_s, kLeastSpeedSigma_m_s);
    }
  }
  if (fix.yaw_rad && std::isfinite(*fix.yaw_rad)) input.yaw_rad = fix.yaw_rad;
  return input;
}

}  // namespace nadir
