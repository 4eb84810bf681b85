#include "mavlink/inertial_motion.hpp"

#include <algorithm>
#include <cmath>

namespace nadir {
namespace {

using Plane = InertialMotion::Plane;
using Moment = InertialMotion::Moment;

constexpr double kAttitudeGap_s = 0.5;
constexpr double kStrongest_m_s2 = 100;  // beyond it is noise of the link, not of the air

// The horizontal part of a specific force, east and north.
Plane level(const Vector3& force, const AircraftAttitude& attitude) {
  const double sin_roll = std::sin(attitude.roll_rad), cos_roll = std::cos(attitude.roll_rad);
  const double sin_pitch = std::sin(attitude.pitch_rad), cos_pitch = std::cos(attitude.pitch_rad);
  const double across = cos_roll * force.y - sin_roll * force.z;
  const double down = sin_roll * force.y + cos_roll * force.z;
  const double along = cos_pitch * force.x + sin_pitch * down;
  const double sin_yaw = std::sin(attitude.yaw_rad), cos_yaw = std::cos(attitude.yaw_rad);
  return {sin_yaw * along + cos_yaw * across, cos_yaw * along - sin_yaw * across};
}

// From `from` on, with that push for as long as it holds.
Moment carried(const Moment& from, const Plane& push_m_s2, double held_s, double to_s) {
  const double dt_s = to_s - from.time_s, pushed_s = std::clamp(dt_s, 0.0, held_s);
  Moment to = from;
  to.time_s = to_s;
  const auto axis = [&](double push, double& velocity, double& way) {
    way += velocity * dt_s + push * pushed_s * (dt_s - pushed_s / 2);
    velocity += push * pushed_s;
  };
  axis(push_m_s2.east, to.velocity_m_s.east, to.way_m.east);
  axis(push_m_s2.north, to.velocity_m_s.north, to.way_m.north);
  to.known_s += pushed_s;
  return to;
}

}  // namespace

void InertialMotion::hear(double time_s, const AircraftAttitude& attitude) {
  if (!std::isfinite(attitude.roll_rad + attitude.pitch_rad + attitude.yaw_rad)) return;
  attitude_ = attitude;
  attitude_s_ = time_s;
}

void InertialMotion::hear(double time_s, const ImuSample& sample) {
  if (sample.instance != 1 || !attitude_ || time_s - attitude_s_ > kAttitudeGap_s) return;
  const Plane push = level(sample.acceleration_m_s2, *attitude_);
  if (!(std::hypot(push.east, push.north) < kStrongest_m_s2)) return;
  if (samples_.empty()) {
    samples_.push_back({{.time_s = time_s}, push});
    return;
  }
  const Moment& last = samples_.back().until;
  if (!(time_s > last.time_s)) return;
  const bool joined = time_s - last.time_s <= kInertialGap_s;
  samples_.push_back({carried(last, push, joined ? kInertialGap_s : 0, time_s), push});
  while (samples_.front().until.time_s < time_s - kKept_s) samples_.pop_front();
}

InertialMotion::Moment InertialMotion::moment(double time_s) const {
  if (samples_.empty()) return {.time_s = time_s};
  const auto after = std::ranges::lower_bound(samples_, time_s, {}, [](const Sample& s) { return s.until.time_s; });
  if (after == samples_.end()) return carried(samples_.back().until, samples_.back().push_m_s2, kInertialGap_s, time_s);
  if (after == samples_.begin()) return carried(after->until, {}, 0, time_s);  // backwards
  const Moment& before = std::prev(after)->until;
  const bool joined = after->until.time_s - before.time_s <= kInertialGap_s;
  return carried(before, after->push_m_s2, joined ? kInertialGap_s : 0, time_s);
}

InertialMotion::Gain InertialMotion::gain(const Moment& from, double to_s) const {
  const double dt_s = to_s - from.time_s;
  const Moment to = moment(to_s);
  Gain gain;
  gain.velocity_m_s = {to.velocity_m_s.east - from.velocity_m_s.east, to.velocity_m_s.north - from.velocity_m_s.north};
  gain.way_m = {to.way_m.east - from.way_m.east - from.velocity_m_s.east * dt_s,
                to.way_m.north - from.way_m.north - from.velocity_m_s.north * dt_s};
  gain.unknown_s = std::max(0.0, dt_s - (to.known_s - from.known_s));
  return gain;
}

}  // namespace nadir
