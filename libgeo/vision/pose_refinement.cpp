#include "vision/pose_refinement.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <opencv2/imgproc.hpp>

#include "vision/matching_plan.hpp"
#include "vision/robust_gauss_newton.hpp"

namespace nadir {
namespace {

std::vector<GroundCorrespondence> correspondences_of(const std::vector<PatchMatch>& matches, const CameraPose& pose,
                                                     const GroundSurface& surface) {
  const double ground_m = surface.height_m(pose.position);
  std::vector<GroundCorrespondence> correspondences;
  for (const PatchMatch& match : matches) {
    const Eigen::Vector3d point = camera_from_ground(pose, match.in_frame, surface);
    correspondences.push_back(
        {point / point.z(), match.on_map, match.information_m2, surface.height_m(match.on_map) - ground_m});
  }
  return correspondences;
}

// Area of the hull around the agreeing patches over the footprint's area.
double spanned_share(const std::vector<PatchMatch>& matches, const SolvedPose& solved, const cv::Mat& mask,
                     double gsd_m, double patch_m) {
  std::vector<cv::Point2f> corners;
  for (std::size_t i = 0; i < matches.size(); ++i) {
    if (!solved.inlier[i]) continue;
    for (const double east : {-patch_m / 2, patch_m / 2}) {
      for (const double north : {-patch_m / 2, patch_m / 2}) {
        corners.emplace_back(static_cast<float>(matches[i].in_frame.east_m + east),
                             static_cast<float>(matches[i].in_frame.north_m + north));
      }
    }
  }
  if (corners.empty()) return 0;
  std::vector<cv::Point2f> hull;
  cv::convexHull(corners, hull);
  return std::min(1.0, cv::contourArea(hull) / (cv::countNonZero(mask) * gsd_m * gsd_m));
}

cv::Mat map_under(const MapWindow& map, const GroundGrid& grid) {
  const cv::Rect part(static_cast<int>(std::lround((grid.west_m - map.west_m) / map.gsd_m)),
                      static_cast<int>(std::lround((map.north_m - grid.north_m) / map.gsd_m)), grid.columns, grid.rows);
  const cv::Rect available = part & cv::Rect(0, 0, map.image.cols, map.image.rows);
  cv::Mat result(part.size(), map.image.type(), cv::Scalar::all(0));
  if (!available.empty()) map.image(available).copyTo(result(available - part.tl()));
  return result;
}

// Scatter of the agreeing patches on one axis, inflated by how many of them count as one independent measurement.
double inflated_sigma_m(const std::vector<PatchMatch>& matches, const SolvedPose& solved) {
  std::vector<Eigen::Vector2d> positions, residuals;
  for (std::size_t i = 0; i < matches.size(); ++i) {
    if (!solved.inlier[i]) continue;
    positions.push_back(matches[i].in_frame.vector());
    residuals.push_back(solved.residual_m[i]);
  }
  const double independent = std::min(kMaxIndependentPatches, effective_sample_size(positions, residuals));
  return solved.rms_m / std::numbers::sqrt2 * std::sqrt(std::max(1.0, solved.inliers / independent));
}

}  // namespace

PoseRefinement::PoseRefinement(const CameraModel& camera, const AnchorPrior& prior, const CameraPose& begin,
                               const MapWindow& map, const GroundSurface& surface)
    : camera_(camera), map_(map), surface_(surface), pose_(begin) {
  prior_.pose = prior.search.pose;
  prior_.pose.attitude.heading_rad = begin.attitude.heading_rad;
  prior_.heading_sigma_rad = std::max(prior.heading_sigma_rad, kRefinementHeadingSigma_rad);
  prior_.log_agl_sigma = prior.log_agl_sigma;
  prior_.tilt_covariance_rad2 = prior.tilt_covariance_rad2;
  prior_.slope_sigma = surface.relief_sigma_m() / footprint_side_m(camera, begin.agl_m);
}

std::optional<GroundGrid> PoseRefinement::grid() const {
  const auto box = footprint_of(camera_, pose_);
  return box ? std::optional(grid_over(*box, map_)) : std::nullopt;
}

bool PoseRefinement::solve(AnchorMatch& match, const PatchMatches& found, const RectifiedFrame& rectified,
                           const CameraPose& rectified_with, double inlier_px, double found_px) {
  prior_.pose.position = pose_.position;
  SolverOptions options;
  options.inlier_m = inlier_px * map_.gsd_m;
  options.min_sigma_m = std::max(map_.gsd_m, scatter_m_);
  match.solved = solve_camera_pose(correspondences_of(found.found, rectified_with, surface_), prior_, options);
  match.patches = found.tried;
  match.rectified = rectified.image.clone();
  match.rectified.setTo(0, rectified.mask == 0);
  match.matched_map = map_under(map_, rectified.grid);
  if (!match.solved) return false;
  scatter_m_ = inflated_sigma_m(found.found, *match.solved);
  match.frame_share = spanned_share(found.found, *match.solved, rectified.mask, map_.gsd_m, found_px * map_.gsd_m);
  pose_ = match.solved->pose;
  return true;
}

}  // namespace nadir
