#include "estimation/plausible_telemetry.hpp"

#include <cmath>
#include <optional>

namespace nadir {
namespace {

constexpr double kLowest_m = 1, kHighest_m = 30'000;  // heights that telemetry may tell
constexpr double kLargestAngle_rad = 100;             // beyond it is no angle but rubbish

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
  return telemetry;
}

}  // namespace nadir
