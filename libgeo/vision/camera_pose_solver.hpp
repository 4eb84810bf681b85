// The camera's position and attitude from rays and the ground points that they hit.
//
// A nadir picture of flat ground tells tilt and position apart only weakly (tilting by 1 degree at 100 m looks like
// moving by 1.7 m, but for the perspective), and an unknown slope of the ground looks like a tilt. So the solver takes
// what is known of attitude, height and slope as prior and returns the covariance of everything. Robust: Geman-McClure
// weights; far-off patches lose their vote altogether.
#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "vision/rectify.hpp"

namespace nadir {

struct GroundCorrespondence {
  Eigen::Vector3d ray;             // in the camera frame, z = 1
  PlanePoint ground;               // what it hit, on the map
  Eigen::Matrix2d information_m2;  // inverse covariance of `ground`
  double height_m = 0;             // of `ground` above the ground under the camera
};

struct PosePrior {
  CameraPose pose;  // position is only the start of the iteration, not a prior
  double heading_sigma_rad = 0.2;
  double log_agl_sigma = 0.1;
  Eigen::Matrix2d tilt_covariance_rad2 = Eigen::Matrix2d::Identity() * 0.01;  // pitch, roll
  double slope_sigma = 0.02;  // of the ground beyond the sights' heights, rise over run
};

struct SolvedPose {
  CameraPose pose;
  // Of (east m, north m, log height, heading, pitch, roll), in this order.
  Eigen::Matrix<double, 6, 6> covariance = Eigen::Matrix<double, 6, 6>::Zero();
  // What the sights alone say, with the priors on height, heading and tilt taken away, in the same order: their
  // information (singular where they say nothing) and how far from `pose` they would go.
  Eigen::Matrix<double, 6, 6> sighted_information = Eigen::Matrix<double, 6, 6>::Zero();
  Eigen::Matrix<double, 6, 1> sighted_pull = Eigen::Matrix<double, 6, 1>::Zero();  // information times the step
  std::vector<bool> inlier;                                                        // per sight
  std::vector<Eigen::Vector2d> residual_m;  // per sight, east and north on the ground
  int inliers = 0;
  double rms_m = 0;  // of the inliers, on the ground
};

struct SolverOptions {
  double inlier_m = 2.0;     // residual on the ground up to which a sight agrees
  double min_sigma_m = 0.5;  // no sight is trusted better than this
};

std::optional<SolvedPose> solve_camera_pose(const std::vector<GroundCorrespondence>& sights, const PosePrior& prior,
                                            const SolverOptions& options);

}  // namespace nadir
