#include "estimation/plausible_telemetry.hpp"

#include <algorithm>
#include <cmath>
#include <optional>

namespace nadir {
namespace {

constexpr double kLowest_m = 1, kHighest_m = 30'000;  // heights that telemetry may tell
constexpr double kLargestAngle_rad = 100;             // beyond it is no angle but rubbish
constexpr double kMostChange_mps = 200;               // from flying one way to flying the other
constexpr double kHardestTurn_mps2 = 60;              // 6 g: what carries a camera does not survive it

}  // namespace

Telemetry plausible_telemetry(Telemetry telemetry, double last_time_s) {
  const auto keep = [](std::optional<double>& value, double low, double high) {
    if (value && !(*value >= low && *value <= high)) value.reset();
  };
  keep(telemetry.agl_m, kLowest_m, kHighest_m);
  keep(telemetry.heading_rad, -kLargestAngle_rad, kLargestAngle_rad);
  keep(telemetry.pitch_rad, -kLargestAngle_rad, kLargestAngle_rad);
  keep(telemetry.roll_rad, -kLargestAngle_rad, kLargestAngle_rad);
  if (!std::isfinite(telemetry.time_s)) telemetry.time_s = last_time_s;
  const double seconds = telemetry.time_s > last_time_s ? telemetry.time_s - last_time_s : 1;
  const double fastest_mps = std::min(kMostChange_mps, kHardestTurn_mps2 * seconds);
  if (telemetry.imu_dv_mps && !(telemetry.imu_dv_mps->norm() <= fastest_mps)) telemetry.imu_dv_mps.reset();
  return telemetry;
}

}  // namespace nadir
