// The camera's position and attitude from rays and the ground points that they meet.
//
// Unknowns: x = (east, north [m], log height, heading, pitch, roll [rad], slope of the ground to the east and north).
// Measurement i: the ray r_i (camera frame) meets the sloping ground at
//   h_i(x) = (east, north) + (agl - height_i) / d_z · d_xy,   d = R(heading, pitch, roll) r_i,
//   d_z = -d.z + slope · d_xy,
// and was found at `ground` on the map. Solved by robust Gauss-Newton (robust_gauss_newton.hpp) with Geman-McClure
// weights: distant outliers lose their weight altogether.
//
// A nadir image of flat ground separates tilt from position only weakly (tilting by 1 degree at 100 m looks like moving
// by 1.7 m, but for the perspective), and an unknown slope of the ground looks like a tilt. So attitude, height and
// slope have priors, and the covariance of everything is returned.
#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "vision/rectification.hpp"

namespace nadir {

struct GroundCorrespondence {
  Eigen::Vector3d ray;             // in the camera frame, z = 1
  PlanePoint ground;               // where it meets the ground, on the map
  Eigen::Matrix2d information_m2;  // inverse covariance of `ground`
  double height_m = 0;             // of `ground` above the ground under the camera
};

struct PosePrior {
  CameraPose pose;  // position is only the start of the iteration, not a prior
  double heading_sigma_rad = kPriorHeadingSigma_rad;
  double log_agl_sigma = kPriorLogAglSigma;
  Eigen::Matrix2d tilt_covariance_rad2 = Eigen::Matrix2d::Identity() * kPriorTiltVariance_rad2;  // pitch, roll
  double slope_sigma = kPriorSlopeSigma;  // of the ground beyond the correspondences' heights, rise over run
};

struct SolvedPose {
  CameraPose pose;
  // Of (east m, north m, log height, heading, pitch, roll), in this order.
  Eigen::Matrix<double, 6, 6> covariance = Eigen::Matrix<double, 6, 6>::Zero();
  // The part of the position's covariance that the unknown slope of the ground causes. With C the covariance of
  // position and slope, and Σ that of the slope before the solution: C Σ⁻¹ Cᵀ. Frames over the same ground share this
  // error; the rest differs from frame to frame.
  Eigen::Matrix2d slope_covariance_m2 = Eigen::Matrix2d::Zero();
  // The correspondences alone, without the priors on height, heading and tilt, in the same order: their
  // information (singular in unconstrained directions), and information times the step from `pose` to their own
  // optimum.
  Eigen::Matrix<double, 6, 6> measurement_information = Eigen::Matrix<double, 6, 6>::Zero();
  Eigen::Matrix<double, 6, 1> measurement_gradient = Eigen::Matrix<double, 6, 1>::Zero();
  std::vector<bool> inlier;                 // per correspondence
  std::vector<Eigen::Vector2d> residual_m;  // per correspondence, east and north on the ground
  int inliers = 0;
  double rms_m = 0;  // of the inliers, on the ground
};

struct SolverOptions {
  double inlier_m = kPoseInlier_m;       // residual on the ground up to which a correspondence agrees
  double min_sigma_m = kPoseMinSigma_m;  // no correspondence is weighted as better than this
};

// Nothing for fewer than four correspondences, rays near the horizon, or when the iteration diverges.
std::optional<SolvedPose> solve_camera_pose(const std::vector<GroundCorrespondence>& correspondences,
                                            const PosePrior& prior, const SolverOptions& options);

}  // namespace nadir
