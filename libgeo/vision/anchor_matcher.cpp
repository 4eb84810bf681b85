#include "vision/anchor_matcher.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <opencv2/imgproc.hpp>

#include "geodesy/web_mercator.hpp"
#include "vision/independent_count.hpp"
#include "vision/patch_match.hpp"

namespace nadir {
namespace {

constexpr int kRounds = 3;
constexpr double kMostIndependentPatches = 30;  // they overlap: no more fit into a frame side by side
constexpr double kAreaWindow_m = 1600;          // side of the squares in which an area is searched
constexpr double kRefineSlack_m = 30;
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

// What the agreeing patches scatter on one axis, made larger by how many of them count as one.
double crowd_sigma_m(const std::vector<PatchMatch>& matches, const SolvedPose& solved) {
  std::vector<Eigen::Vector2d> places, residuals;
  for (std::size_t i = 0; i < matches.size(); ++i) {
    if (!solved.inlier[i]) continue;
    places.emplace_back(matches[i].in_frame.east_m, matches[i].in_frame.north_m);
    residuals.push_back(solved.residual_m[i]);
  }
  const double independent = std::min(kMostIndependentPatches, independent_count(places, residuals));
  return solved.rms_m / std::numbers::sqrt2 * std::sqrt(std::max(1.0, solved.inliers / independent));
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
  double scatter_m = 0;
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
    options.min_sigma_m = std::max(map.gsd_m, scatter_m);
    auto solved = solve_camera_pose(sights_of(matches.found, pose, surface), pose_prior, options);
    match.patches = matches.tried;
    match.rectified = rectified.image;
    match.rectified.setTo(0, rectified.mask == 0);
    match.matched_map = map_under(map, *grid);
    match.solved = std::move(solved);
    if (!match.solved) return;
    scatter_m = crowd_sigma_m(matches.found, *match.solved);
    match.frame_share =
        spanned_share(matches.found, *match.solved, rectified.mask, map.gsd_m, patches.patch_px * map.gsd_m);
    pose = match.solved->pose;
  }
}

// What both ways of searching need.
struct Matching {
  SearchOptions options;
  MatchingScale scale;
  double reach_m = 0;  // how far from the camera's foot point a footprint may reach
};

std::optional<Matching> matching_for(const CameraModel& camera, const TileSource& tiles, const LocalFrame& frame,
                                     const SearchPrior& prior) {
  const LonLat middle = frame.lonlat_from_enu(prior.pose.position.east_m, prior.pose.position.north_m);
  Matching matching;
  matching.scale = matching_scale(camera, prior.pose.agl_m, ground_resolution_m(tiles.zooms().max, middle.lat_deg));
  matching.options.gsd_m = matching.scale.coarse_gsd_m;
  matching.options.distinct_m = std::max(25.0, 12 * matching.scale.coarse_gsd_m);
  CameraPose highest = prior.pose;
  highest.agl_m *= 1 + prior.scale_range;
  highest.position = {};
  const auto footprint = footprint_of(camera, highest);
  if (!footprint) return std::nullopt;
  matching.reach_m =
      1.05 *
      std::max({std::hypot(footprint->west_m, footprint->north_m), std::hypot(footprint->east_m, footprint->north_m),
                std::hypot(footprint->west_m, footprint->south_m), std::hypot(footprint->east_m, footprint->south_m)});
  return matching;
}

AnchorMatch begun(const Matching& matching) {
  AnchorMatch match;
  match.fine_gsd_m = matching.scale.fine_gsd_m;
  match.coarse_gsd_m = matching.scale.coarse_gsd_m;
  return match;
}

// Squares that cover the area, each small enough for one transform.
std::vector<SearchPrior> windows_over(const PlaneBox& area, const SearchPrior& prior) {
  const double east_m = area.east_m - area.west_m, north_m = area.north_m - area.south_m;
  const auto columns = static_cast<int>(std::max(1.0, std::ceil(east_m / kAreaWindow_m)));
  const auto rows = static_cast<int>(std::max(1.0, std::ceil(north_m / kAreaWindow_m)));
  std::vector<SearchPrior> windows;
  for (int row = 0; row < rows; ++row) {
    for (int column = 0; column < columns; ++column) {
      SearchPrior window = prior;
      window.pose.position = {area.west_m + (column + 0.5) * east_m / columns,
                              area.south_m + (row + 0.5) * north_m / rows};
      window.radius_m = std::max(east_m / columns, north_m / rows) / 2;
      windows.push_back(window);
    }
  }
  return windows;
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
  const auto matching = matching_for(camera, tiles, frame, prior.search);
  if (!matching) return {};
  AnchorMatch match = begun(*matching);
  SearchPrior search = prior.search;
  // Without room for other places there is nothing to compare the best one with.
  search.radius_m = std::max(search.radius_m, 2.2 * matching->options.distinct_m);
  const MapWindow window =
      read_map_window(tiles, frame, around(search.pose.position, search.radius_m + matching->reach_m),
                      matching->scale.fine_gsd_m, Colour::grey);
  match.on_map = cv::countNonZero(window.mask) > 0;
  if (!match.on_map) return match;
  const MapWindow map = cropped_to_map(window, matching->reach_m / 2);

  match.search = search_place(grey, camera, map, search, matching->options);
  if (!match.search.places.empty()) refine(match, grey, camera, map, prior, surface);
  return match;
}

AnchorMatch match_anchor_anywhere(const cv::Mat& grey, const CameraModel& camera, const TileSource& tiles,
                                  const LocalFrame& frame, const AnchorPrior& prior, const PlaneBox& area,
                                  const GroundSurface& surface) {
  const auto matching = matching_for(camera, tiles, frame, prior.search);
  if (!matching) return {};
  AnchorMatch match = begun(*matching);
  match.on_map = false;
  std::vector<Place> places;
  for (const SearchPrior& search : windows_over(area, prior.search)) {
    const MapWindow window =
        read_map_window(tiles, frame, around(search.pose.position, search.radius_m + matching->reach_m),
                        matching->scale.coarse_gsd_m, Colour::grey);
    if (cv::countNonZero(window.mask) == 0) continue;
    match.on_map = true;
    const SearchResult found =
        search_place(grey, camera, cropped_to_map(window, matching->reach_m / 2), search, matching->options);
    places.insert(places.end(), found.places.begin(), found.places.end());
  }
  match.search = best_of(std::move(places), matching->options);
  if (match.search.places.empty()) return match;
  AnchorPrior there = prior;
  there.search.pose.position = match.search.places.front().pose.position;
  const MapWindow map =
      read_map_window(tiles, frame, around(there.search.pose.position, kRefineSlack_m + matching->reach_m),
                      matching->scale.fine_gsd_m, Colour::grey);
  refine(match, grey, camera, map, there, surface);
  return match;
}

}  // namespace nadir
