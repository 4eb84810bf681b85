#include "estimation/correlated_frames.hpp"

#include <algorithm>
#include <cmath>
#include <opencv2/core.hpp>
#include <optional>

#include "vision/map_search.hpp"
#include "vision/matching_plan.hpp"
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

PlaneBox around_both(const PlaneBox& one, const PlaneBox& other, double margin_m) {
  PlaneBox all = one;
  all.west_m = std::min(one.west_m, other.west_m - margin_m);
  all.south_m = std::min(one.south_m, other.south_m - margin_m);
  all.east_m = std::max(one.east_m, other.east_m + margin_m);
  all.north_m = std::max(one.north_m, other.north_m + margin_m);
  return all;
}

CameraPose pose_of(const OdometryFrame& frame) { return {{}, frame.agl_m, frame.attitude}; }

cv::Point2f pixel_of(const OdometryFrame& frame, const CameraPose& pose, PlanePoint ground) {
  const Eigen::Vector2d pixel = frame.camera.pixel_from_point(camera_from_ground(pose, ground));
  return {static_cast<float>(pixel.x()), static_cast<float>(pixel.y())};
}

// The frame before as the map of what the frame now may show; nothing where that is more than a level flight sees.
std::optional<MapWindow> map_of(const OdometryFrame& before, const OdometryFrame& now, double gsd_m, double reach_m) {
  const CameraPose pose = pose_of(before);
  const auto seen_before = footprint_of(before.camera, pose), seen_now = footprint_of(now.camera, pose_of(now));
  if (!seen_before || !seen_now) return std::nullopt;
  const PlaneBox searched = around_both(*seen_before, *seen_now, reach_m + tuned::kMargin_px * gsd_m);
  const double most_m = tuned::kMostSide_px * gsd_m;
  if (searched.east_m - searched.west_m > most_m || searched.north_m - searched.south_m > most_m) return std::nullopt;
  MapWindow map;
  map.west_m = searched.west_m;
  map.north_m = searched.north_m;
  map.gsd_m = gsd_m;
  const ReducedFrame frame = reduce_frame(with_contrast(before.grey), before.camera, before.agl_m, gsd_m);
  const RectifiedFrame ground = rectify(frame, pose, grid_over(searched, map));
  map.image = ground.image;
  map.mask = ground.mask;
  return map;
}

// Where the frame now was taken, if one place of the map stands out.
std::optional<CameraPose> place_on(const MapWindow& map, const OdometryFrame& now, const cv::Mat& grey,
                                   double reach_m) {
  SearchPrior prior;
  prior.pose = pose_of(now);
  prior.radius_m = reach_m;
  SearchOptions options;
  options.gsd_m = map.gsd_m;
  options.distinct_m = tuned::kDistinct_px * map.gsd_m;
  const SearchResult found = search_window(grey, now.camera, map, prior, options);
  const bool several = found.places.size() > 1;
  if (found.places.empty() || (several && found.ratio > tuned::kMaxRatio)) return std::nullopt;
  return found.places.front().pose;
}

PatchMatches patches_on(const MapWindow& map, const OdometryFrame& now, const cv::Mat& grey, const CameraPose& pose) {
  const auto footprint = footprint_of(now.camera, pose);
  if (!footprint) return {};
  PatchOptions options;
  options.patch_px = tuned::kPatch_px;
  options.columns = tuned::kPatchColumns;
  options.rows = tuned::kPatchRows;
  options.search_px = tuned::kPatchSearch_px;
  const ReducedFrame frame = reduce_frame(grey, now.camera, now.agl_m, map.gsd_m);
  return match_patches(rectify(frame, pose, grid_over(*footprint, map)), frame.camera, pose, map, options);
}

}  // namespace

PixelPairs correlated_pixels(const OdometryFrame& before, const OdometryFrame& now) {
  const double side_m = footprint_side_m(before.camera, before.agl_m);
  const double gsd_m = side_m / tuned::kWidth_px, reach_m = tuned::kReachShare * side_m;
  const auto map = map_of(before, now, gsd_m, reach_m);
  if (!map) return {};
  const cv::Mat grey = with_contrast(now.grey);
  const auto pose = place_on(*map, now, grey, reach_m);
  if (!pose) return {};
  PixelPairs pairs;
  pairs.redundancy = tuned::kRedundancy;
  for (const PatchMatch& match : patches_on(*map, now, grey, *pose).found) {
    pairs.before.push_back(pixel_of(before, pose_of(before), match.on_map));
    pairs.now.push_back(pixel_of(now, *pose, match.in_frame));
  }
  return pairs;
}

}  // namespace nadir
