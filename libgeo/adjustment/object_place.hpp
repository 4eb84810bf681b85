// Where on the ground is what frames show at these pixels, and how far off can that be?
//
// One sighting: the ray through the pixel is followed until it meets the ground for the first time. With the hit
//   X = C + t d,   d = R ray(pixel),   X_up = ground(X_east, X_north),
// the errors of the pose, of the pixel and of the ground's height h move it by the derivatives of that equation:
//   dX = (I - d nᵀ / (nᵀ d)) (dC + t dd) + d / (nᵀ d) dh,    n = (-slope_east, -slope_north, 1).
//
// Several sightings of the same object, of one frame or of many, are adjusted together: X minimises
//   (z - pixels(X))ᵀ V⁻¹ (z - pixels(X)) + ((X_up - ground(X)) / σ_terrain)²,    V = σ_px² I + J_pose P J_poseᵀ,
// the point where the rays come closest to each other by their own covariance, and to the ground. Sightings in one
// frame share its error. Covariance: (Jᵀ V⁻¹ J)⁻¹.
//
// Frames share errors as well: neighbours of an adjusted block err together, and averaging does not help. P is the
// joint covariance of the frames (AdjustedBlock::joint_covariance()). Where it is not known, rays are weighted and
// tested as if the frames' errors were independent, and the covariance is the larger one, in each direction, of
// independent errors and of one error that all frames share.
//
// Do the clicks agree? The sum above has the distribution of χ² with 2n - 2 degrees of freedom if they do. Beyond its
// 99.9 % they do not: `agrees` is false, `worst` names the sighting that the others contradict most (the test of
// Baarda 1968 for a block of two), and the covariance is scaled up until the residuals fit.
#pragma once

#include <Eigen/Core>
#include <optional>
#include <span>
#include <string_view>
#include <variant>
#include <vector>

#include "adjustment/adjustment_parameters.hpp"
#include "adjustment/pose_covariance.hpp"
#include "geodesy/error_ellipse.hpp"
#include "vision/ground_surface.hpp"

namespace nadir {

struct SightedFrame {
  CameraPose pose;
  PoseCovariance covariance = PoseCovariance::Zero();
};

struct ObjectSighting {
  std::size_t frame = 0;  // in the list of frames
  Eigen::Vector2d pixel = Eigen::Vector2d::Zero();
  double sigma_px = parameters::adjustment::kClickSigma_px;  // each axis
};

struct LocatedObject {
  PlanePoint place;
  double height_m = 0;  // above the plane
  Eigen::Matrix3d covariance_m2 = Eigen::Matrix3d::Zero();
  ErrorEllipse ellipse_95;                   // horizontal, 95 %
  std::vector<Eigen::Vector2d> residual_px;  // seen minus clicked, per sighting
  double chi2 = 0;
  int degrees_of_freedom = 0;  // 0: one sighting, nothing to be tested
  bool agrees = true;
  std::optional<std::size_t> worst{};  // sighting, where they do not agree
};

enum class LocationProblem {
  above_horizon,  // of a single sighting: its ray does not go down
  no_ground,      // it meets no ground within 20 km
  diverging,      // several sightings, but no point is in front of all cameras
};
std::string_view name_of(LocationProblem problem);

// terrain_sigma_m: of the object above or below the surface. joint_covariance: of the frames, in their order, six rows
// each; its diagonal blocks replace the frames' own. Throws UsageError for no sightings or more than 32, frames that
// are not in the list, values that are not finite, and sigmas that are not positive.
std::variant<LocatedObject, LocationProblem> place_object(
    const CameraModel& camera, const GroundSurface& ground, std::span<const SightedFrame> frames,
    std::span<const ObjectSighting> sightings, double terrain_sigma_m,
    const std::optional<Eigen::MatrixXd>& joint_covariance = std::nullopt);

ErrorEllipse error_ellipse_95(const Eigen::Matrix2d& covariance_m2);

}  // namespace nadir
