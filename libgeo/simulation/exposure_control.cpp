#include "simulation/exposure_control.hpp"

#include <cmath>

namespace nadir {
namespace {

constexpr double kShutter_s = 1 / 800.0;

// Pixels that the ground moves over the picture while the shutter is open.
Eigen::Vector2d motion_px(const CameraModel& camera, const FlightPose& pose, double shutter_s) {
  const double c = std::cos(pose.attitude.heading_rad), s = std::sin(pose.attitude.heading_rad);
  const double ahead = pose.velocity.y() * c + pose.velocity.x() * s,
               right = pose.velocity.x() * c - pose.velocity.y() * s;
  const double scale = shutter_s / pose.agl_m;
  return {-right * scale * camera.fx, ahead * scale * camera.fy};
}

}  // namespace

ExposureControl::ExposureControl(const CameraModel& camera, std::uint64_t seed)
    : camera_(camera), seed_(seed), light_(hash_of(seed, 31), 45) {}

Exposure ExposureControl::of(const FlightPose& pose, std::uint64_t frame) const {
  Exposure exposure;
  exposure.gain = 1.10 * (1 + 0.12 * light_.at(pose.time_s, 0.5) +
                          0.03 * (unit_hash(seed_, 32, static_cast<std::int64_t>(frame)) - 0.5));
  exposure.warmth = light_.at(pose.time_s, 400.5);
  exposure.motion_px = motion_px(camera_, pose, kShutter_s / exposure.gain);
  return exposure;
}

}  // namespace nadir
