#include "simulation/mems_imu.hpp"

#include <Eigen/Geometry>
#include <cmath>

#include "geodesy/gravity.hpp"

namespace nadir {
namespace {

constexpr double kEarthRate_rad_s = 7.292115e-5;  // IERS 2010

Eigen::Vector3d normals(Random& random) {
  Eigen::Vector3d values;
  for (double& value : values) value = random.normal();
  return values;
}

Eigen::Matrix3d scale_errors(double sigma, Random& random) {
  Eigen::Matrix3d errors;
  for (int column = 0; column < 3; ++column) errors.col(column) = sigma * normals(random);
  return Eigen::Matrix3d::Identity() + errors;
}

}  // namespace

MemsImu::MemsImu(const MemsFigures& figures, double latitude_rad, Random random, bool exact)
    : figures_(figures),
      earth_rate_rad_s_(kEarthRate_rad_s * Eigen::Vector3d(0, std::cos(latitude_rad), std::sin(latitude_rad))),
      random_(random),
      exact_(exact) {
  const auto begun = [this](double bias, double instability) {
    const Eigen::Matrix3d scale = scale_errors(figures_.scale, random_);
    const Eigen::Vector3d constant = bias * normals(random_);
    return Sensor{scale, constant, instability * normals(random_), Eigen::Vector3d::Zero()};
  };
  rate_ = begun(figures_.rate_bias_rad_s, figures_.rate_instability_rad_s);
  force_ = begun(figures_.force_bias_mps2, figures_.force_instability_mps2);
}

Eigen::Vector3d MemsImu::with_errors(Sensor& sensor, const Eigen::Vector3d& exact, double dt, double noise,
                                     double instability, double walk) {
  const double keep = std::exp(-dt / figures_.instability_s);
  sensor.instability = keep * sensor.instability + std::sqrt(1 - keep * keep) * instability * normals(random_);
  sensor.walk += std::sqrt(dt) * walk * normals(random_);
  return sensor.scale * exact + sensor.constant + sensor.instability + sensor.walk +
         noise / std::sqrt(dt) * normals(random_);
}

MeasuredRates MemsImu::measure(const BodyMotion& before, const BodyMotion& now) {
  const double dt = now.time_s - before.time_s;
  // The body against the world, which turns under it.
  const Eigen::AngleAxisd turn(before.enu_from_body.transpose() * now.enu_from_body);
  const Eigen::Matrix3d middle =
      before.enu_from_body * Eigen::AngleAxisd(turn.angle() / 2, turn.axis()).toRotationMatrix();
  const Eigen::Vector3d rate = turn.axis() * (turn.angle() / dt) + middle.transpose() * earth_rate_rad_s_;
  const Eigen::Vector3d velocity = (before.velocity_mps + now.velocity_mps) / 2;
  const Eigen::Vector3d acceleration = (now.velocity_mps - before.velocity_mps) / dt;
  const Eigen::Vector3d force = middle.transpose() * (acceleration + 2 * earth_rate_rad_s_.cross(velocity) +
                                                      Eigen::Vector3d(0, 0, kStandardGravity_mps2));
  if (exact_) return {now.time_s, rate, force};
  return {now.time_s,
          with_errors(rate_, rate, dt, figures_.rate_noise_rad_s, figures_.rate_instability_rad_s,
                      figures_.rate_walk_rad_s),
          with_errors(force_, force, dt, figures_.force_noise_mps2, figures_.force_instability_mps2,
                      figures_.force_walk_mps2)};
}

}  // namespace nadir
