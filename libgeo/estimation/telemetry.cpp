#include "estimation/telemetry.hpp"

#include <algorithm>
#include <cmath>

#include "vision/localizer_parameters.hpp"

namespace nadir {
namespace {

using namespace parameters::plausible;

bool plausible_change(const std::optional<Eigen::Vector2d>& dv_mps, double seconds) {
  return !dv_mps || dv_mps->norm() <= std::min(kMaxVelocityChange_mps, kMaxAcceleration_mps2 * seconds);
}

// Duration of the intervals; nothing when they do not fit into the time between the frames.
std::optional<double> plausible_duration_s(const std::vector<TelemetryInterval>& intervals, double between_s) {
  double sum_s = 0;
  for (const TelemetryInterval& interval : intervals) {
    if (!(interval.seconds > 0)) return std::nullopt;
    sum_s += interval.seconds;
  }
  if (!(sum_s < between_s)) return std::nullopt;
  return sum_s;
}

}  // namespace

Telemetry plausible_telemetry(Telemetry telemetry, double last_time_s) {
  const auto keep = [](std::optional<double>& value, double low, double high) {
    if (value && !(*value >= low && *value <= high)) value.reset();
  };
  keep(telemetry.agl_m, kMinAgl_m, kMaxAgl_m);
  keep(telemetry.heading_rad, -kMaxAngle_rad, kMaxAngle_rad);
  keep(telemetry.pitch_rad, -kMaxAngle_rad, kMaxAngle_rad);
  keep(telemetry.roll_rad, -kMaxAngle_rad, kMaxAngle_rad);
  if (telemetry.rate_rad_s && !(telemetry.rate_rad_s->norm() <= kMaxRate_rad_s)) telemetry.rate_rad_s.reset();
  if (!std::isfinite(telemetry.time_s)) telemetry.time_s = last_time_s;
  if (!telemetry.inertial.empty()) telemetry.inertial = usable_samples(telemetry.inertial, last_time_s);
  double seconds = telemetry.time_s > last_time_s ? telemetry.time_s - last_time_s : 1;
  if (!telemetry.intervals.empty()) {
    if (const auto intervals_s = plausible_duration_s(telemetry.intervals, telemetry.time_s - last_time_s)) {
      seconds -= *intervals_s;
    } else {
      telemetry.intervals.clear();
      telemetry.imu_dv_mps.reset();  // it covers the time after them alone
    }
  }
  for (TelemetryInterval& interval : telemetry.intervals) {
    keep(interval.heading_rad, -kMaxAngle_rad, kMaxAngle_rad);
    if (!plausible_change(interval.imu_dv_mps, interval.seconds)) interval.imu_dv_mps.reset();
  }
  if (!plausible_change(telemetry.imu_dv_mps, seconds)) telemetry.imu_dv_mps.reset();
  return telemetry;
}

}  // namespace nadir
