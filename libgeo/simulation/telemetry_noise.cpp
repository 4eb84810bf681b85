#include "simulation/telemetry_noise.hpp"

#include <algorithm>
#include <cmath>

namespace nadir {
namespace {

constexpr double kBiasTime_s = 60;  // dead reckoning time that the stated sigma of the accelerometer refers to

}  // namespace

void TelemetryNoise::GaussMarkov::propagate(double seconds, Random& random) {
  const double keep = std::exp(-seconds / correlation_s);
  value = keep * value + std::sqrt(1 - keep * keep) * random.normal();
}

TelemetryNoise::TelemetryNoise(const TelemetryUncertainty& uncertainty, std::uint64_t seed)
    : sigma_(uncertainty), random_(Random(seed).fork("telemetry")), imu_random_(Random(seed).fork("imu")) {
  heading_bias_ = 0.6 * sigma_.heading_rad * std::clamp(random_.normal(), -2.0, 2.0);
  Random compass = Random(seed).fork("compass");
  for (double& coefficient : deviation_) {
    coefficient = 0.6 * sigma_.heading_rad * std::clamp(compass.normal(), -2.0, 2.0);
  }
  height_ = {std::clamp(random_.normal(), -2.0, 2.0), 240};
  pitch_ = {std::clamp(random_.normal(), -2.0, 2.0), 90};
  roll_ = {std::clamp(random_.normal(), -2.0, 2.0), 90};
  imu_east_ = {std::clamp(imu_random_.normal(), -2.0, 2.0), 300};
  imu_north_ = {std::clamp(imu_random_.normal(), -2.0, 2.0), 300};
}

std::optional<Eigen::Vector2d> velocity_change(const std::optional<FlightPose>& before, const FlightPose& pose) {
  if (!before) return std::nullopt;
  return pose.velocity_mps - before->velocity_mps;
}

double TelemetryNoise::compass_error(double heading_rad) const {
  return heading_bias_ + deviation_.dot(Eigen::Vector2d(std::sin(heading_rad), std::cos(heading_rad)));
}

// White noise and a bias that together reach the stated sigma after a minute: 0.6² + 0.8² = 1.
std::optional<Eigen::Vector2d> TelemetryNoise::measure_velocity_change(const FlightPose& pose) {
  const auto exact = velocity_change(last_pose_, pose);
  const double dt = last_pose_ ? pose.time_s - last_pose_->time_s : 0;
  last_pose_ = pose;
  if (!exact) return std::nullopt;
  for (GaussMarkov* process : {&imu_east_, &imu_north_}) process->propagate(dt, imu_random_);
  const double bias_mps2 = 0.8 * sigma_.imu_dv_mps / std::sqrt(kBiasTime_s);
  const double off = compass_error(pose.attitude.heading_rad), c = std::cos(off), s = std::sin(off);
  Eigen::Vector2d measured(c * exact->x() + s * exact->y(), -s * exact->x() + c * exact->y());
  measured += dt * bias_mps2 * Eigen::Vector2d(imu_east_.value, imu_north_.value);
  for (double& axis : measured) axis += 0.6 * sigma_.imu_dv_mps * std::sqrt(dt) * imu_random_.normal();
  return measured;
}

MeasuredPose TelemetryNoise::measure(const FlightPose& pose) {
  if (last_s_ >= 0) {
    for (GaussMarkov* process : {&height_, &pitch_, &roll_}) process->propagate(pose.time_s - last_s_, random_);
  }
  last_s_ = pose.time_s;
  MeasuredPose measured;
  measured.time_s = pose.time_s;
  // The parts add up to the stated sigma: 0.6² + 0.6² + 0.53² = 1, 0.95² + 0.31² = 1, 0.75² + 0.66² = 1.
  const double heading = pose.attitude.heading_rad;
  measured.attitude.heading_rad = heading + compass_error(heading) + 0.53 * sigma_.heading_rad * random_.normal();
  measured.agl_m = pose.pressure_agl_m * (1 + sigma_.agl_relative * (0.95 * height_.value + 0.31 * random_.normal()));
  measured.attitude.pitch_rad =
      pose.attitude.pitch_rad + sigma_.tilt_rad * (0.75 * pitch_.value + 0.66 * random_.normal());
  measured.attitude.roll_rad =
      pose.attitude.roll_rad + sigma_.tilt_rad * (0.75 * roll_.value + 0.66 * random_.normal());
  measured.imu_dv_mps = measure_velocity_change(pose);
  return measured;
}

}  // namespace nadir
