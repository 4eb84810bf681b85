#include "fixes/inertial_motion.hpp"

#include <algorithm>
#include <cmath>

#include "geodesy/hypotenuse.hpp"

namespace nadir {
namespace {

using Plane = InertialMotion::Plane;
using Moment = InertialMotion::Moment;

constexpr double kAttitudeGap_s = 0.5;
constexpr double kMaxSpecificForce_mps2 = 100;  // beyond: corrupt data

// The horizontal part of a specific force.
Plane level(const Vector3& force, const AircraftAttitude& attitude) {
  const double sin_roll = std::sin(attitude.roll_rad), cos_roll = std::cos(attitude.roll_rad);
  const double sin_pitch = std::sin(attitude.pitch_rad), cos_pitch = std::cos(attitude.pitch_rad);
  const double across = cos_roll * force.y - sin_roll * force.z;
  const double down = sin_roll * force.y + cos_roll * force.z;
  const double along = cos_pitch * force.x + sin_pitch * down;
  const double sin_yaw = std::sin(attitude.yaw_rad), cos_yaw = std::cos(attitude.yaw_rad);
  return {sin_yaw * along + cos_yaw * across, cos_yaw * along - sin_yaw * across};
}

// Propagates `from` with this acceleration for as long as it holds.
Moment propagated(const Moment& from, const Plane& acceleration_mps2, double held_s, double to_s) {
  const double dt_s = to_s - from.time_s, accelerated_s = std::clamp(dt_s, 0.0, held_s);
  Moment to = from;
  to.time_s = to_s;
  const auto axis = [&](double acceleration, double& velocity, double& displacement) {
    displacement += velocity * dt_s + acceleration * accelerated_s * (dt_s - accelerated_s / 2);
    velocity += acceleration * accelerated_s;
  };
  axis(acceleration_mps2.east, to.velocity_mps.east, to.displacement_m.east);
  axis(acceleration_mps2.north, to.velocity_mps.north, to.displacement_m.north);
  to.known_s += accelerated_s;
  return to;
}

}  // namespace

void InertialMotion::on_message(double time_s, const AircraftAttitude& attitude) {
  if (!std::isfinite(attitude.roll_rad + attitude.pitch_rad + attitude.yaw_rad)) return;
  attitude_ = attitude;
  attitude_s_ = time_s;
}

void InertialMotion::on_message(double time_s, const ImuSample& sample) {
  if (sample.instance != 1 || !attitude_ || time_s - attitude_s_ > kAttitudeGap_s) return;
  const Plane acceleration = level(sample.acceleration_mps2, *attitude_);
  if (!(hypotenuse(acceleration.east, acceleration.north) < kMaxSpecificForce_mps2)) return;
  if (samples_.empty()) {
    samples_.push_back({{.time_s = time_s}, acceleration});
    return;
  }
  const Moment& last = samples_.back().until;
  if (!(time_s > last.time_s)) return;
  const bool continuous = time_s - last.time_s <= kInertialGap_s;
  samples_.push_back({propagated(last, acceleration, continuous ? kInertialGap_s : 0, time_s), acceleration});
  while (samples_.front().until.time_s < time_s - kKept_s) samples_.pop_front();
}

InertialMotion::Moment InertialMotion::moment(double time_s) const {
  if (samples_.empty()) return {.time_s = time_s};
  const auto after = std::ranges::lower_bound(samples_, time_s, {}, [](const Sample& s) { return s.until.time_s; });
  if (after == samples_.end())
    return propagated(samples_.back().until, samples_.back().acceleration_mps2, kInertialGap_s, time_s);
  if (after == samples_.begin()) return propagated(after->until, {}, 0, time_s);  // extrapolates backwards
  const Moment& before = std::prev(after)->until;
  const bool continuous = after->until.time_s - before.time_s <= kInertialGap_s;
  return propagated(before, after->acceleration_mps2, continuous ? kInertialGap_s : 0, time_s);
}

InertialMotion::Gain InertialMotion::gain(const Moment& from, double to_s) const {
  const double dt_s = to_s - from.time_s;
  const Moment to = moment(to_s);
  Gain gain;
  gain.velocity_mps = {to.velocity_mps.east - from.velocity_mps.east, to.velocity_mps.north - from.velocity_mps.north};
  gain.displacement_m = {to.displacement_m.east - from.displacement_m.east - from.velocity_mps.east * dt_s,
                         to.displacement_m.north - from.displacement_m.north - from.velocity_mps.north * dt_s};
  gain.unknown_s = std::max(0.0, dt_s - (to.known_s - from.known_s));
  return gain;
}

}  // namespace nadir
