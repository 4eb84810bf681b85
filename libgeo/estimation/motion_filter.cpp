#include "estimation/motion_filter.hpp"

#include <Eigen/LU>
#include <cmath>

namespace nadir {

MotionFilter::MotionFilter(const Eigen::Vector2d& position_m, double sigma_m, const MotionOptions& options)
    : options_(options) {
  state_.head<2>() = position_m;
  const double v = options.start_velocity_sigma_mps;
  covariance_.diagonal() << sigma_m * sigma_m, sigma_m * sigma_m, v * v, v * v;
}

void MotionFilter::advance(double seconds) {
  if (seconds <= 0) return;
  Eigen::Matrix4d transition = Eigen::Matrix4d::Identity();
  transition(0, 2) = transition(1, 3) = seconds;
  state_ = (transition * state_).eval();
  covariance_ = (transition * covariance_ * transition.transpose()).eval();
  const double q = options_.acceleration_mps2 * options_.acceleration_mps2;
  const double t2 = seconds * seconds, t3 = t2 * seconds;
  for (int axis = 0; axis < 2; ++axis) {  // white acceleration noise, integrated
    covariance_(axis, axis) += q * t3 / 3;
    covariance_(axis, axis + 2) += q * t2 / 2;
    covariance_(axis + 2, axis) += q * t2 / 2;
    covariance_(axis + 2, axis + 2) += q * seconds;
  }
  // An aircraft cannot become arbitrarily fast, however long nothing was seen.
  const double ceiling = 4 * options_.start_velocity_sigma_mps * options_.start_velocity_sigma_mps;
  for (int axis = 2; axis < 4; ++axis) {
    if (covariance_(axis, axis) <= ceiling) continue;
    const double shrink = std::sqrt(ceiling / covariance_(axis, axis));
    covariance_.row(axis) *= shrink;
    covariance_.col(axis) *= shrink;
  }
}

void MotionFilter::advance(double seconds, const Step& step) {
  state_.head<2>() += step.moved_m;
  covariance_.topLeftCorner<2, 2>() += step.covariance_m2;
  carried_m_ += step.moved_m;
  heading_sigma_rad_ = step.heading_sigma_rad;
  scale_sigma_ = step.scale_sigma;
  if (seconds <= 0) return;
  state_.tail<2>() = step.moved_m / seconds;
  const double share = std::hypot(step.heading_sigma_rad, step.scale_sigma);
  const double q = options_.acceleration_mps2 * options_.acceleration_mps2;
  covariance_.topRightCorner<2, 2>().setZero();
  covariance_.bottomLeftCorner<2, 2>().setZero();
  covariance_.bottomRightCorner<2, 2>() =
      step.covariance_m2 / (seconds * seconds) +
      Eigen::Matrix2d::Identity() * (q * seconds + share * share * state_.tail<2>().squaredNorm());
}

Eigen::Matrix2d MotionFilter::covariance_m2() const {
  const Eigen::Vector2d across(-carried_m_.y(), carried_m_.x());
  return covariance_.topLeftCorner<2, 2>() + scale_sigma_ * scale_sigma_ * carried_m_ * carried_m_.transpose() +
         heading_sigma_rad_ * heading_sigma_rad_ * across * across.transpose();
}

double MotionFilter::sigma_m() const { return std::sqrt(0.5 * covariance_m2().trace()); }

double MotionFilter::chi2(const Eigen::Vector2d& position_m, const Eigen::Matrix2d& covariance_m2_in) const {
  const Eigen::Vector2d off = position_m - this->position_m();
  return off.dot((covariance_m2() + covariance_m2_in).inverse() * off);
}

void MotionFilter::anchor(const Eigen::Vector2d& position_m, const Eigen::Matrix2d& measured_m2) {
  covariance_.topLeftCorner<2, 2>() = covariance_m2();  // the shared error becomes part of the position's
  carried_m_.setZero();
  const Eigen::Matrix2d innovation = covariance_.topLeftCorner<2, 2>() + measured_m2;
  const Eigen::Matrix<double, 4, 2> gain = covariance_.leftCols<2>() * innovation.inverse();
  state_ += gain * (position_m - state_.head<2>());
  covariance_ -= gain * innovation * gain.transpose();
  covariance_ = 0.5 * (covariance_ + covariance_.transpose()).eval();
}

void MotionFilter::restart(const Eigen::Vector2d& position_m, const Eigen::Matrix2d& covariance_m2_in) {
  state_.head<2>() = position_m;
  covariance_.topRightCorner<2, 2>().setZero();
  covariance_.bottomLeftCorner<2, 2>().setZero();
  covariance_.topLeftCorner<2, 2>() = covariance_m2_in;
  carried_m_.setZero();
}

}  // namespace nadir
