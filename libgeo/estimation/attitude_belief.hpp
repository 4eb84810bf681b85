// What is believed about heading, tilt and height beyond the telemetry: slow errors, learnt from anchors.
//
// Telemetry has a constant part of error (compass bias, mounting of the camera, barometer and terrain) and a part that
// changes from frame to frame. Only the constant part can be learnt; the changing part stays in every sigma.
#pragma once

#include <Eigen/Core>
#include <optional>

#include "estimation/telemetry.hpp"
#include "vision/camera_model.hpp"
#include "vision/camera_pose_solver.hpp"

namespace nadir {

// Heading of image-up, and the constant error of the telemetry's heading: true = telemetry + bias.
class HeadingBelief {
 public:
  explicit HeadingBelief(double telemetry_sigma_rad);

  // A new frame. turn_rad: change of heading seen by odometry, with its sigma.
  struct Turn {
    double turn_rad = 0;
    double sigma_rad = 0;
  };
  void advance(std::optional<double> telemetry_rad, std::optional<Turn> turn);
  void observe(double heading_rad, double sigma_rad);

  double heading_rad() const { return state_.x(); }
  double sigma_rad() const;
  double bias_rad() const { return state_.y(); }

 private:
  void update(const Eigen::Vector2d& gain_row, double innovation, double variance);

  double noise_sigma_rad_;
  Eigen::Vector2d state_ = Eigen::Vector2d::Zero();  // heading, bias
  Eigen::Matrix2d covariance_;
  bool known_ = false;
};

// Height above ground over the telemetry's height, as a logarithm.
class HeightBelief {
 public:
  explicit HeightBelief(double relative_sigma);

  void advance();
  void observe(double log_scale, double sigma);

  double scale() const;
  double sigma() const;

 private:
  double prior_variance_;
  double log_scale_ = 0;
  double variance_;
};

// Constant tilt of the camera against the telemetry's pitch and roll: mounting and boresight. How much tilt changes
// from frame to frame beyond that (a gimbal: hardly; a bare airframe without logged attitude: a lot) is learnt as well.
class BoresightBelief {
 public:
  // logged: the telemetry carries pitch and roll; otherwise the aircraft's own tilt is in the changing part as well.
  BoresightBelief(double tilt_sigma_rad, bool logged);

  // Attitude systems drift: the constant part is one for a minute or two only.
  void advance(double seconds);
  // shared_error_factor: how many sights over the same ground count as one.
  void observe(const SolvedPose& solved, const Eigen::Vector2d& telemetry_tilt_rad, double shared_error_factor = 1);

  const Eigen::Vector2d& tilt_rad() const { return tilt_; }  // pitch, roll
  const Eigen::Matrix2d& constant_covariance_rad2() const { return covariance_; }
  double changing_sigma_rad() const;              // of one frame, each axis
  Eigen::Matrix2d frame_covariance_rad2() const;  // of one frame's tilt: both parts

 private:
  Eigen::Vector2d tilt_ = Eigen::Vector2d::Zero();
  Eigen::Matrix2d covariance_;
  double prior_variance_;
  double drift_variance_per_s_;
  double least_variance_;  // of the changing part
  double variance_sum_;    // of the changing part, weighted by how often it was seen; begins with the prior
  double variance_weight_;
};

}  // namespace nadir
