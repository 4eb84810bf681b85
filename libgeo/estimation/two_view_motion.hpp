// Motion of the camera between two images of the same ground, from the rays to points that both see.
//
// A ray r through the image of a camera with attitude R = enu_from_camera, h above the ground and at position p meets a
// plane of slope s (rise over run) in
//
//   g(r) = p + h / (-(Rr)_up + s · (Rr)_east,north) · (Rr)_east,north
//
// For the pairs (r_before, r_now) the residual is g_now(r_now) - g_before(r_before), two metres each. Unknowns: the
// displacement (east, north), the log of the height ratio, the change of heading, and both pitches and rolls. All but
// the displacement have priors: at the edge of an image one degree of tilt moves the ground as much as metres of
// flight, and telemetry is rarely better than that. Solved by robust Gauss-Newton (vision/robust_gauss_newton.hpp); σ
// of the residuals comes from themselves, but is not below a pixel or what the relief explains by parallax.
#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "vision/localizer_parameters.hpp"
#include "vision/rectification.hpp"

namespace nadir {

struct RayPair {
  Eigen::Vector3d ray_before;  // camera frames, z = 1
  Eigen::Vector3d ray_now;
};

struct TwoViewPrior {
  CameraPose before;  // positions are ignored
  CameraPose now;
  double heading_sigma_rad = parameters::two_view_motion::kDefaultHeadingSigma_rad;  // of the change of heading
  // Of (pitch, roll) before and (pitch, roll) now. A tilt that both share (boresight) makes them correlate.
  Eigen::Matrix4d tilt_covariance_rad2 =
      Eigen::Matrix4d::Identity() * parameters::two_view_motion::kDefaultTiltVariance_rad2;
  // Of the plane that both images show: rise over run to the east and to the north. Heights are above it.
  Eigen::Vector2d ground_slope = Eigen::Vector2d::Zero();
  double log_height_sigma = parameters::two_view_motion::kDefaultLogHeightSigma;  // of the change of height
  double relief_sigma_m = parameters::two_view_motion::kDefaultReliefSigma_m;     // of the ground beyond the plane
  // How many pairs count as one at least: those of overlapping patches show the same pixels. The residuals may say
  // more.
  double redundancy = 1;
};

struct TwoViewMotion {
  Eigen::Vector2d displacement_m = Eigen::Vector2d::Zero();  // east, north
  Eigen::Matrix2d covariance_m2 = Eigen::Matrix2d::Zero();
  double turn_rad = 0;
  int inliers = 0;
  // All unknowns, in the order of RelativeMotionMeasurement (pose_measurements.hpp). Then that of the images alone,
  // with the priors taken away: information Λ_images = Λ - Λ_prior, and its gradient at the solution, Λ_prior · solved.
  Eigen::Matrix<double, 8, 1> solved = Eigen::Matrix<double, 8, 1>::Zero();
  Eigen::Matrix<double, 8, 8> measurement_information = Eigen::Matrix<double, 8, 8>::Zero();
  Eigen::Matrix<double, 8, 1> measurement_gradient = Eigen::Matrix<double, 8, 1>::Zero();
};

// Nothing with fewer than six pairs, when a ray sees the horizon, when the iteration diverges, and when the residuals
// show no single motion.
std::optional<TwoViewMotion> solve_two_view_motion(const std::vector<RayPair>& pairs, const TwoViewPrior& prior);

}  // namespace nadir
