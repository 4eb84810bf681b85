#include "estimation/attitude_belief.hpp"

#include <Eigen/LU>
#include <cmath>

#include "geodesy/angles.hpp"

namespace nadir {
namespace {

constexpr double kUnknownHeadingVariance = 4.0;  // rad²: about 115 degrees, any heading
constexpr double kChangingHeadingShare = 0.5;    // of the telemetry's sigma that changes from frame to frame
constexpr double kHeightWanderShare = 0.12;      // of the sigma, per frame: terrain rolls by under the aircraft
constexpr double kChangingTiltShareLogged = 0.7;
constexpr double kChangingTiltShareUnlogged = 0.3;
constexpr double kTiltDriftTime_s = 120;          // in which the constant part drifts by …
constexpr double kTiltDriftShareLogged = 0.5;     // … this share of its prior variance: attitude from an AHRS
constexpr double kTiltDriftShareUnlogged = 0.01;  // … or this: a mount or a gimbal
constexpr double kChangingTiltPriorFrames = 3;    // how many frames the prior of the changing part is worth
constexpr double kVaguestSight = 16;              // variance over the changing part's, to learn from it
constexpr double kLeastChangingTilt_rad = 0.004;  // a quarter of a degree: no mount is stiffer
constexpr double kLeastHeightSigma = 0.012;       // roofs, trees and rolling ground

}  // namespace

HeadingBelief::HeadingBelief(double telemetry_sigma_rad)
    : noise_sigma_rad_(kChangingHeadingShare * telemetry_sigma_rad),
      covariance_(Eigen::Vector2d(kUnknownHeadingVariance, telemetry_sigma_rad * telemetry_sigma_rad).asDiagonal()) {}

double HeadingBelief::sigma_rad() const { return std::sqrt(covariance_(0, 0)); }

void HeadingBelief::update(const Eigen::Vector2d& row, double innovation, double variance) {
  const Eigen::Vector2d gain = covariance_ * row / (row.dot(covariance_ * row) + variance);
  state_ += gain * innovation;
  covariance_ = ((Eigen::Matrix2d::Identity() - gain * row.transpose()) * covariance_).eval();
  covariance_ = 0.5 * (covariance_ + covariance_.transpose()).eval();
}

void HeadingBelief::advance(std::optional<double> telemetry_rad, std::optional<Turn> turn) {
  if (known_ && turn) {
    state_.x() += turn->turn_rad;
    covariance_(0, 0) += turn->sigma_rad * turn->sigma_rad;
  } else {  // nothing links this frame's heading to the last one's
    if (telemetry_rad) state_.x() = *telemetry_rad + state_.y();
    covariance_(0, 0) = kUnknownHeadingVariance;
    covariance_(0, 1) = covariance_(1, 0) = 0;
  }
  if (telemetry_rad) {
    update({1, -1}, wrap_pi(*telemetry_rad - (state_.x() - state_.y())), noise_sigma_rad_ * noise_sigma_rad_);
    known_ = true;
  }
}

void HeadingBelief::observe(double heading_rad, double sigma_rad) {
  update({1, 0}, wrap_pi(heading_rad - state_.x()), sigma_rad * sigma_rad);
  known_ = true;
}

HeightBelief::HeightBelief(double relative_sigma)
    : prior_variance_(relative_sigma * relative_sigma), variance_(prior_variance_) {}

void HeightBelief::advance() {
  variance_ = std::min(prior_variance_, variance_ + kHeightWanderShare * kHeightWanderShare * prior_variance_);
}

void HeightBelief::observe(double log_scale, double sigma) {
  const double gain = variance_ / (variance_ + sigma * sigma);
  log_scale_ += gain * (log_scale - log_scale_);
  variance_ *= 1 - gain;
}

double HeightBelief::scale() const { return std::exp(log_scale_); }
double HeightBelief::sigma() const { return std::max(kLeastHeightSigma, std::sqrt(variance_)); }

BoresightBelief::BoresightBelief(double tilt_sigma_rad, bool logged)
    : covariance_(Eigen::Matrix2d::Identity() * (tilt_sigma_rad * tilt_sigma_rad)),
      prior_variance_(tilt_sigma_rad * tilt_sigma_rad),
      drift_variance_per_s_((logged ? kTiltDriftShareLogged : kTiltDriftShareUnlogged) * prior_variance_ /
                            kTiltDriftTime_s),
      least_variance_(kLeastChangingTilt_rad * kLeastChangingTilt_rad),
      variance_weight_(kChangingTiltPriorFrames) {
  const double changing = (logged ? kChangingTiltShareLogged : kChangingTiltShareUnlogged) * tilt_sigma_rad;
  variance_sum_ = variance_weight_ * changing * changing;
}

void BoresightBelief::advance(double seconds) {
  const double more = drift_variance_per_s_ * std::max(0.0, seconds);
  for (int axis = 0; axis < 2; ++axis) {
    covariance_(axis, axis) =
        std::max(covariance_(axis, axis), std::min(prior_variance_, covariance_(axis, axis) + more));
  }
}

double BoresightBelief::changing_sigma_rad() const {
  return std::sqrt(std::max(least_variance_, variance_sum_ / variance_weight_));
}

Eigen::Matrix2d BoresightBelief::frame_covariance_rad2() const {
  const double changing = changing_sigma_rad();
  return covariance_ + Eigen::Matrix2d::Identity() * (changing * changing);
}

void BoresightBelief::observe(const SolvedPose& solved, const Eigen::Vector2d& telemetry_tilt_rad,
                              double shared_error_factor) {
  const Eigen::Matrix2d information = solved.tilt_information_rad2 + 1e-6 * Eigen::Matrix2d::Identity();
  const Eigen::Matrix2d sighted = information.inverse();
  const double changing = changing_sigma_rad();
  const Eigen::Vector2d innovation = solved.sighted_tilt_rad - telemetry_tilt_rad - tilt_;
  // What the innovations scatter beyond what is known to scatter is the changing part. A vague sight says little of it.
  const double known = 0.5 * (covariance_ + sighted).trace();
  // Much vaguer sights say nothing, and would only wear the sum away.
  if (known < kVaguestSight * changing * changing) {
    const double weight = changing * changing / (changing * changing + known);
    variance_sum_ += weight * (0.5 * innovation.squaredNorm() - known);
    variance_weight_ += weight;
  }
  variance_sum_ = std::max(variance_sum_, 0.0);

  const Eigen::Matrix2d measured = sighted + Eigen::Matrix2d::Identity() * (changing * changing);
  const Eigen::Matrix2d gain = covariance_ * (covariance_ + measured * shared_error_factor).inverse();
  tilt_ += gain * innovation;
  covariance_ = ((Eigen::Matrix2d::Identity() - gain) * covariance_).eval();
  covariance_ = 0.5 * (covariance_ + covariance_.transpose()).eval();
}

}  // namespace nadir
