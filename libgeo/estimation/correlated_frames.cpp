#include "estimation/correlated_frames.hpp"

#include <algorithm>
#include <cmath>
#include <opencv2/core.hpp>

#include "vision/map_search.hpp"
#include "vision/patch_matching.hpp"

namespace nadir {

namespace tuned = parameters::correlated_frames;

namespace {

// A dark picture has few grey levels: they are spread before pixels are averaged, so that rounding takes nothing away.
cv::Mat with_contrast(const cv::Mat& grey) {
  cv::Scalar mean, deviation;
  cv::meanStdDev(grey, mean, deviation);
  const double gain = std::max(1.0, tuned::kContrast / std::max(1.0, deviation[0]));
  cv::Mat levels(1, 256, CV_8UC1), result;
  for (int i = 0; i < levels.cols; ++i) {
    levels.at<std::uint8_t>(i) = cv::saturate_cast<std::uint8_t>(tuned::kMiddleGrey + gain * (i - mean[0]));
  }
  cv::LUT(grey, levels, result);
  return result;
}

GroundGrid grid_over(const PlaneBox& box, double gsd_m, PlanePoint corner) {
  const double left = std::floor((box.west_m - corner.east_m) / gsd_m);
  const double top = std::floor((corner.north_m - box.north_m) / gsd_m);
  GroundGrid grid{corner.east_m + left * gsd_m, corner.north_m - top * gsd_m, gsd_m, 0, 0};
  grid.columns = static_cast<int>(std::ceil((box.east_m - grid.west_m) / gsd_m));
  grid.rows = static_cast<int>(std::ceil((grid.north_m - box.south_m) / gsd_m));
  return grid;
}

PlaneBox around_both(const PlaneBox& one, const PlaneBox& other, double margin_m) {
  PlaneBox all = one;
  all.west_m = std::min(one.west_m, other.west_m - margin_m);
  all.south_m = std::min(one.south_m, other.south_m - margin_m);
  all.east_m = std::max(one.east_m, other.east_m + margin_m);
  all.north_m = std::max(one.north_m, other.north_m + margin_m);
  return all;
}

cv::Point2f pixel_of(const OdometryFrame& frame, const CameraPose& pose, PlanePoint ground) {
  const Eigen::Vector2d pixel = frame.camera.pixel_from_point(camera_from_ground(pose, ground));
  return {static_cast<float>(pixel.x()), static_cast<float>(pixel.y())};
}

}  // namespace

PixelPairs correlated_pixels(const OdometryFrame& before, const OdometryFrame& now) {
  const CameraPose pose_before{{}, before.agl_m, before.attitude}, predicted{{}, now.agl_m, now.attitude};
  const auto seen_before = footprint_of(before.camera, pose_before), seen_now = footprint_of(now.camera, predicted);
  if (!seen_before || !seen_now) return {};
  const double side_m = footprint_side_m(before.camera, before.agl_m), gsd_m = side_m / tuned::kWidth_px;
  SearchPrior prior;
  prior.pose = predicted;
  prior.radius_m = tuned::kReachShare * side_m;

  const PlaneBox searched = around_both(*seen_before, *seen_now, prior.radius_m + tuned::kMargin_px * gsd_m);
  const double most_m = tuned::kMostSide_px * gsd_m;
  if (searched.east_m - searched.west_m > most_m || searched.north_m - searched.south_m > most_m) return {};
  const GroundGrid grid = grid_over(searched, gsd_m, {searched.west_m, searched.north_m});
  const RectifiedFrame ground =
      rectify(reduce_frame(with_contrast(before.grey), before.camera, before.agl_m, gsd_m), pose_before, grid);
  MapWindow map;
  map.image = ground.image;
  map.mask = ground.mask;
  map.west_m = grid.west_m;
  map.north_m = grid.north_m;
  map.gsd_m = gsd_m;

  SearchOptions search;
  search.gsd_m = gsd_m;
  search.distinct_m = tuned::kDistinct_px * gsd_m;
  const cv::Mat grey = with_contrast(now.grey);
  const SearchResult found = search_window(grey, now.camera, map, prior, search);
  const bool several = found.places.size() > 1;
  if (found.places.empty() || (several && found.ratio > tuned::kMaxRatio)) return {};

  const CameraPose pose = found.places.front().pose;
  const auto footprint = footprint_of(now.camera, pose);
  if (!footprint) return {};
  const ReducedFrame frame = reduce_frame(grey, now.camera, now.agl_m, gsd_m);
  const RectifiedFrame rectified = rectify(frame, pose, grid_over(*footprint, gsd_m, {grid.west_m, grid.north_m}));
  PatchOptions patches;
  patches.patch_px = tuned::kPatch_px;
  patches.columns = tuned::kPatchColumns;
  patches.rows = tuned::kPatchRows;
  patches.search_px = tuned::kPatchSearch_px;
  PixelPairs pairs;
  pairs.redundancy = tuned::kRedundancy;
  for (const PatchMatch& match : match_patches(rectified, frame.camera, pose, map, patches).found) {
    pairs.before.push_back(pixel_of(before, pose_before, match.on_map));
    pairs.now.push_back(pixel_of(now, pose, match.in_frame));
  }
  return pairs;
}

}  // namespace nadir
