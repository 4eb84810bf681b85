// How a camera moved between two pictures of the same flat ground, from the rays to points that both saw.
//
// Both tilts, the change of heading and of height are unknowns with priors: at the edge of a picture one degree of tilt
// moves the ground as much as metres of flight, and telemetry is rarely better than that.
#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "vision/rectification.hpp"

namespace nadir {

struct RayPair {
  Eigen::Vector3d ray_before;  // camera frames, z = 1
  Eigen::Vector3d ray_now;
};

struct TwoViewPrior {
  CameraPose before;  // positions are ignored
  CameraPose now;
  double heading_sigma_rad = 0.1;  // of the change of heading
  // Of (pitch, roll) before and (pitch, roll) now. A tilt that both share (boresight) makes them correlate.
  Eigen::Matrix4d tilt_covariance_rad2 = Eigen::Matrix4d::Identity() * 1e-3;
  // Of the plane that both pictures show: rise over run to the east and to the north. Heights are above it.
  Eigen::Vector2d ground_slope = Eigen::Vector2d::Zero();
  double log_height_sigma = 0.03;  // of the change of height
  double relief_sigma_m = 1.5;     // of the ground's height beyond the plane: it moves points by parallax
};

struct TwoViewMotion {
  Eigen::Vector2d moved_m = Eigen::Vector2d::Zero();  // east, north
  Eigen::Matrix2d covariance_m2 = Eigen::Matrix2d::Zero();
  double turn_rad = 0;
  int inliers = 0;
  // What the sights alone say, with the priors taken away, about (motion; changes of the priors' log height ratio,
  // change of heading, pitch and roll before, pitch and roll now): information, and where they pull to. See
  // RelativeMotionMeasurement in pose_sights.hpp.
  Eigen::Matrix<double, 8, 1> solved = Eigen::Matrix<double, 8, 1>::Zero();
  Eigen::Matrix<double, 8, 8> measurement_information = Eigen::Matrix<double, 8, 8>::Zero();
  Eigen::Matrix<double, 8, 1> measurement_gradient = Eigen::Matrix<double, 8, 1>::Zero();
};

std::optional<TwoViewMotion> solve_two_view_motion(const std::vector<RayPair>& sights, const TwoViewPrior& prior);

}  // namespace nadir
