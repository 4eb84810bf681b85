#include "estimation/strapdown_step.hpp"

#include <algorithm>
#include <cmath>

#include "geodesy/angles.hpp"
#include "vision/camera.hpp"
#include "vision/localizer_parameters.hpp"

namespace nadir {
namespace {

using namespace parameters::inertial;
using Eigen::Matrix3d;
using Eigen::Vector3d;
using Row = StrapdownStep::Row;

double heading_of(const Matrix3d& world_from_sensor) {
  return std::atan2(world_from_sensor(0, 0), world_from_sensor(1, 0));
}

// Errors that turns or changes of velocity make in one direction add up over a manoeuvre. Variance in proportion to the
// change makes as much of a whole manoeuvre (so long) as if they did.
double coherent_variance(double share, double change, double manoeuvre) { return share * share * change * manoeuvre; }

}  // namespace

Matrix3d world_from_sensor(double heading_rad, double pitch_rad, double roll_rad) {
  const Matrix3d camera = enu_from_camera({heading_rad, pitch_rad, roll_rad});  // axes: right, down the image, optical
  Matrix3d sensor;
  sensor << -camera.col(1), camera.col(0), camera.col(2);
  return sensor;
}

Vector3d camera_angles(const Matrix3d& world_from_sensor) {
  const Matrix3d& r = world_from_sensor;
  return {heading_of(r), std::asin(std::clamp(r(2, 0), -1.0, 1.0)), std::atan2(-r(2, 1), -r(2, 2))};
}

Matrix3d attitude_error_by_angles(double heading_rad) {
  const double s = std::sin(heading_rad), c = std::cos(heading_rad);
  Matrix3d turned;
  turned << 0, c, s, 0, -s, c, -1, 0, 0;  // about up (counted clockwise), image-right, image-up
  return turned;
}

StrapdownStep strapdown_step(const Matrix3d& before, const PreintegratedMotion& preintegrated,
                             const InertialCalibration& calibration, const Eigen::Vector2d& velocity_mps,
                             const Vector3d& earth_rate_rad_s) {
  const double dt = preintegrated.seconds;
  const Vector3d mean_rate =
      rotation_vector_of(preintegrated.turn) / dt + preintegrated.bias.rate_rad_s - calibration.bias.rate_rad_s;
  InertialBias bias = calibration.bias;
  bias.rate_rad_s += calibration.rate_scale * mean_rate;
  const PreintegratedMotion motion = preintegrated.with_bias(bias);
  StrapdownStep step;
  step.world_from_sensor = rotation_of(-earth_rate_rad_s * dt) * before * motion.turn;
  const Matrix3d& after = step.world_from_sensor;
  const Vector3d velocity = before * motion.velocity_change_mps, displacement = before * motion.displacement_m;
  const Vector3d over_ground(velocity_mps.x(), velocity_mps.y(), 0);
  const Vector3d coriolis = -2 * cross_matrix(earth_rate_rad_s) * over_ground;
  step.added << (displacement + dt * dt / 2 * coriolis).head<2>(), (velocity + dt * coriolis).head<2>(),
      wrap_pi(heading_of(after) - heading_of(before));

  const Matrix3d turn_by_rate = after * motion.turn_by_rate;
  step.added_by_errors.setZero();
  step.added_by_errors.block<2, 3>(Row::position_east, 0) = -cross_matrix(displacement).topRows<2>();
  step.added_by_errors.block<2, 3>(Row::position_east, 3) = (before * motion.displacement_by_rate).topRows<2>();
  step.added_by_errors.block<2, 3>(Row::position_east, 6) = (before * motion.displacement_by_force).topRows<2>();
  step.added_by_errors.block<2, 3>(Row::velocity_east, 0) = -cross_matrix(velocity).topRows<2>();
  step.added_by_errors.block<2, 3>(Row::velocity_east, 3) = (before * motion.velocity_by_rate).topRows<2>();
  step.added_by_errors.block<2, 3>(Row::velocity_east, 6) = (before * motion.velocity_by_force).topRows<2>();
  step.added_by_errors.block<1, 3>(Row::heading, 3) = -turn_by_rate.row(2);
  step.error_transition.setIdentity();
  step.error_transition.block<3, 3>(0, 3) = turn_by_rate;
  for (int axis = 0; axis < 3; ++axis) {
    const int scale = StrapdownStep::rate_scale + 3 * axis;
    step.added_by_errors.middleCols<3>(scale) =
        mean_rate[axis] * step.added_by_errors.middleCols<3>(StrapdownStep::rate_bias);
    step.error_transition.block<3, 3>(0, scale) = mean_rate[axis] * turn_by_rate;
  }

  // What white noise does, from the order (turn, velocity, displacement) of the preintegration.
  Eigen::Matrix<double, StrapdownStep::kRows, 9> by_noise = Eigen::Matrix<double, StrapdownStep::kRows, 9>::Zero();
  by_noise.block<2, 3>(Row::position_east, 6) = before.topRows<2>();
  by_noise.block<2, 3>(Row::velocity_east, 3) = before.topRows<2>();
  by_noise.block<1, 3>(Row::heading, 0) = -after.row(2);
  by_noise.block<3, 3>(Row::errors, 0) = after;
  const Eigen::Matrix<double, StrapdownStep::kRows, 9> spread = by_noise * motion.covariance;
  step.noise = spread * by_noise.transpose();
  // Beyond what M models.
  const double angle_rad = rotation_vector_of(motion.turn).norm();
  const double turn_variance = coherent_variance(kRateScaleRest, angle_rad, kManoeuvreTurn_rad);
  for (int axis = 0; axis < 3; ++axis) step.noise(Row::errors + axis, Row::errors + axis) += turn_variance;
  step.noise(Row::heading, Row::heading) += turn_variance;
  step.noise(Row::heading, Row::errors + 2) -= turn_variance;
  step.noise(Row::errors + 2, Row::heading) -= turn_variance;
  const double speed_variance = coherent_variance(kForceScale, velocity.head<2>().norm(), kManoeuvreChange_mps);
  for (int axis = 0; axis < 2; ++axis) {
    const int p = Row::position_east + axis, v = Row::velocity_east + axis;
    step.noise(v, v) += speed_variance;
    step.noise(p, v) += dt / 2 * speed_variance;
    step.noise(v, p) += dt / 2 * speed_variance;
    step.noise(p, p) += dt * dt / 4 * speed_variance;
  }
  for (int axis = 3; axis < 6; ++axis) {
    step.noise(Row::errors + axis, Row::errors + axis) += kRateBiasWalk_rad_s * kRateBiasWalk_rad_s * dt;
    step.noise(Row::errors + axis + 3, Row::errors + axis + 3) += kForceBiasWalk_mps2 * kForceBiasWalk_mps2 * dt;
  }
  return step;
}

}  // namespace nadir
