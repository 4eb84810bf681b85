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

bool plausible_change(const std::optional<Eigen::Vector2d>& dv_mps, double seconds) {
  return !dv_mps || dv_mps->norm() <= std::min(kMostChange_mps, kHardestTurn_mps2 * seconds);
}

// How long the way took; nothing when it cannot be that of the time between.
std::optional<double> sound_way_s(const std::vector<TelemetryInterval>& way, double between_s) {
  double sum_s = 0;
  for (const TelemetryInterval& stretch : way) {
    if (!(stretch.seconds > 0)) return std::nullopt;
    sum_s += stretch.seconds;
  }
  if (!(sum_s < between_s)) return std::nullopt;
  return sum_s;
}

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
  double seconds = telemetry.time_s > last_time_s ? telemetry.time_s - last_time_s : 1;
  if (!telemetry.way.empty()) {
    if (const auto way_s = sound_way_s(telemetry.way, telemetry.time_s - last_time_s)) {
      seconds -= *way_s;
    } else {
      telemetry.way.clear();
      telemetry.imu_dv_mps.reset();  // which is of its end alone
    }
  }
  for (TelemetryInterval& stretch : telemetry.way) {
    keep(stretch.heading_rad, -kLargestAngle_rad, kLargestAngle_rad);
    if (!plausible_change(stretch.imu_dv_mps, stretch.seconds)) stretch.imu_dv_mps.reset();
  }
  if (!plausible_change(telemetry.imu_dv_mps, seconds)) telemetry.imu_dv_mps.reset();
  return telemetry;
}

}  // namespace nadir
