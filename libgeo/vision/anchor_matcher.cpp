#include "vision/anchor_matcher.hpp"

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>

#include "geodesy/web_mercator.hpp"
#include "vision/patch_match.hpp"

namespace nadir {
namespace {

constexpr int kRounds = 3;
constexpr double kIndependentPatches = 9;
constexpr double kFineTemplate_px = 400;    // longer side of the fine template
constexpr double kCoarseTemplate_px = 170;  // still enough structure to find a place among thousands

PlaneBox around(PlanePoint middle, double half_side_m) {
  return {middle.east_m - half_side_m, middle.north_m - half_side_m, middle.east_m + half_side_m,
          middle.north_m + half_side_m};
}

// A grid over the pose's footprint, aligned with the map window's pixels.
std::optional<GroundGrid> aligned_grid(const CameraModel& camera, const CameraPose& pose, const MapWindow& map) {
  const auto box = footprint_of(camera, pose);
  if (!box) return std::nullopt;
  const double left = std::floor((box->west_m - map.west_m) / map.gsd_m);
  const double top = std::floor((map.north_m - box->north_m) / map.gsd_m);
  GroundGrid grid;
  grid.gsd_m = map.gsd_m;
  grid.west_m = map.west_m + left * map.gsd_m;
  grid.north_m = map.north_m - top * map.gsd_m;
  grid.columns = static_cast<int>(std::ceil((box->east_m - grid.west_m) / grid.gsd_m));
  grid.rows = static_cast<int>(std::ceil((grid.north_m - box->south_m) / grid.gsd_m));
  return grid;
}

std::vector<GroundSight> sights_of(const std::vector<PatchMatch>& matches, const CameraPose& pose,
                                   const GroundSurface& surface) {
  const double foot_m = surface.height_m(pose.position);
  std::vector<GroundSight> sights;
  for (const PatchMatch& match : matches) {
    const Eigen::Vector3d point = camera_from_ground(pose, match.in_frame, surface);
    sights.push_back({point / point.z(), match.on_map, match.information_m2, surface.height_m(match.on_map) - foot_m});
  }
  return sights;
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

// Leaves out what no placement needs: the window beyond the map, but for a rim that a template may overhang.
MapWindow cropped_to_map(const MapWindow& map, double rim_m) {
  const int rim = static_cast<int>(std::ceil(rim_m / map.gsd_m));
  const cv::Rect box = cv::boundingRect(map.mask);
  const cv::Rect kept = cv::Rect(box.x - rim, box.y - rim, box.width + 2 * rim, box.height + 2 * rim) &
                        cv::Rect(0, 0, map.image.cols, map.image.rows);
  MapWindow result = map;
  result.image = map.image(kept);
  result.mask = map.mask(kept);
  result.west_m += kept.x * map.gsd_m;
  result.north_m -= kept.y * map.gsd_m;
  return result;
}

cv::Mat map_under(const MapWindow& map, const GroundGrid& grid) {
  const cv::Rect part(static_cast<int>(std::lround((grid.west_m - map.west_m) / map.gsd_m)),
                      static_cast<int>(std::lround((map.north_m - grid.north_m) / map.gsd_m)), grid.columns, grid.rows);
  const cv::Rect available = part & cv::Rect(0, 0, map.image.cols, map.image.rows);
  cv::Mat result(part.size(), map.image.type(), cv::Scalar::all(0));
  if (!available.empty()) map.image(available).copyTo(result(available - part.tl()));
  return result;
}

// Patches overlap, and roofs displace whole neighbourhoods alike: what scatters among the agreeing ones counts as much
// as if only kIndependentPatches of them were independent.
double independent_sigma_m(const std::optional<SolvedPose>& last_round) {
  if (!last_round) return 0;
  return last_round->rms_m * std::sqrt(std::max(1.0, last_round->inliers / kIndependentPatches));
}

void refine(AnchorMatch& match, const cv::Mat& grey, const CameraModel& camera, const MapWindow& map,
            const AnchorPrior& prior, const GroundSurface& surface) {
  CameraPose pose = match.search.places.front().pose;
  const ReducedFrame frame = reduce_frame(grey, camera, pose.agl_m, map.gsd_m);
  PosePrior pose_prior;
  pose_prior.pose = prior.search.pose;
  pose_prior.pose.attitude.heading_rad = pose.attitude.heading_rad;
  pose_prior.heading_sigma_rad = std::max(prior.heading_sigma_rad, 0.05);  // the search has just measured it
  pose_prior.log_agl_sigma = prior.log_agl_sigma;
  pose_prior.tilt_covariance_rad2 = prior.tilt_covariance_rad2;
  pose_prior.slope_sigma = surface.relief_sigma_m() / footprint_side_m(camera, pose.agl_m);
  PatchOptions patches;
  for (int round = 0; round < kRounds; ++round) {
    patches.columns = round == 0 ? 8 : 12;
    patches.rows = round == 0 ? 6 : 8;
    patches.search_px = round == 0 ? 12 : round == 1 ? 8 : 6;
    const auto grid = aligned_grid(camera, pose, map);
    if (!grid) return;
    const RectifiedFrame rectified = rectify(frame, pose, *grid, surface);
    const PatchMatches matches = match_patches(rectified, frame.camera, pose, map, patches, surface);
    pose_prior.pose.position = pose.position;
    SolverOptions options;
    options.inlier_m = (round == 0 ? 7.0 : 3.5) * map.gsd_m;
    options.min_sigma_m = std::max(map.gsd_m, independent_sigma_m(match.solved));
    auto solved = solve_camera_pose(sights_of(matches.found, pose, surface), pose_prior, options);
    match.patches = matches.tried;
    match.rectified = rectified.image;
    match.rectified.setTo(0, rectified.mask == 0);
    match.matched_map = map_under(map, *grid);
    match.solved = std::move(solved);
    if (!match.solved) return;
    match.frame_share =
        spanned_share(matches.found, *match.solved, rectified.mask, map.gsd_m, patches.patch_px * map.gsd_m);
    pose = match.solved->pose;
  }
}

}  // namespace

MatchingScale matching_scale(const CameraModel& camera, double agl_m, double map_gsd_m) {
  const double frame_gsd_m = gsd_at(camera, agl_m);
  const double side_m = frame_gsd_m * std::max(camera.width, camera.height);
  MatchingScale scale;
  scale.fine_gsd_m = std::max({frame_gsd_m, map_gsd_m, side_m / kFineTemplate_px});
  scale.coarse_gsd_m = std::max(scale.fine_gsd_m, side_m / kCoarseTemplate_px);
  return scale;
}

AnchorMatch match_anchor(const cv::Mat& grey, const CameraModel& camera, const TileSource& tiles,
                         const LocalFrame& frame, const AnchorPrior& prior, const GroundSurface& surface) {
  AnchorMatch match;
  SearchPrior search = prior.search;
  const LonLat middle = frame.lonlat_from_enu(search.pose.position.east_m, search.pose.position.north_m);
  const MatchingScale scale =
      matching_scale(camera, search.pose.agl_m, ground_resolution_m(tiles.zooms().max, middle.lat_deg));
  SearchOptions options;
  options.gsd_m = scale.coarse_gsd_m;
  options.distinct_m = std::max(25.0, 12 * scale.coarse_gsd_m);
  // Without room for other places there is nothing to compare the best one with.
  search.radius_m = std::max(search.radius_m, 2.2 * options.distinct_m);
  match.fine_gsd_m = scale.fine_gsd_m;
  match.coarse_gsd_m = scale.coarse_gsd_m;

  CameraPose highest = search.pose;
  highest.agl_m *= 1 + search.scale_range;
  highest.position = {};
  const auto footprint = footprint_of(camera, highest);
  if (!footprint) return match;
  const double reach_m =
      1.05 *
      std::max({std::hypot(footprint->west_m, footprint->north_m), std::hypot(footprint->east_m, footprint->north_m),
                std::hypot(footprint->west_m, footprint->south_m), std::hypot(footprint->east_m, footprint->south_m)});
  const MapWindow window = read_map_window(tiles, frame, around(search.pose.position, search.radius_m + reach_m),
                                           scale.fine_gsd_m, Colour::grey);
  match.on_map = cv::countNonZero(window.mask) > 0;
  if (!match.on_map) return match;
  const MapWindow map = cropped_to_map(window, reach_m / 2);

  match.search = search_place(grey, camera, map, search, options);
  if (!match.search.places.empty()) refine(match, grey, camera, map, prior, surface);
  return match;
}

}  // namespace nadir
