#include "vision/matching_plan.hpp"

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>

#include "geodesy/hypotenuse.hpp"
#include "geodesy/web_mercator.hpp"
#include "vision/area_resize.hpp"

namespace nadir {

GroundGrid grid_over(const PlaneBox& box, const MapWindow& map) {
  const double left = std::floor((box.west_m - map.west_m) / map.gsd_m);
  const double top = std::floor((map.north_m - box.north_m) / map.gsd_m);
  GroundGrid grid;
  grid.gsd_m = map.gsd_m;
  grid.west_m = map.west_m + left * map.gsd_m;
  grid.north_m = map.north_m - top * map.gsd_m;
  grid.columns = static_cast<int>(std::ceil((box.east_m - grid.west_m) / grid.gsd_m));
  grid.rows = static_cast<int>(std::ceil((grid.north_m - box.south_m) / grid.gsd_m));
  return grid;
}

MapWindow cropped_to_map(const MapWindow& map, double margin_m) {
  const int margin = static_cast<int>(std::ceil(margin_m / map.gsd_m));
  const cv::Rect box = cv::boundingRect(map.mask);
  const cv::Rect kept = cv::Rect(box.x - margin, box.y - margin, box.width + 2 * margin, box.height + 2 * margin) &
                        cv::Rect(0, 0, map.image.cols, map.image.rows);
  MapWindow result = map;
  result.image = map.image(kept);
  result.mask = map.mask(kept);
  result.west_m += kept.x * map.gsd_m;
  result.north_m -= kept.y * map.gsd_m;
  return result;
}

MapWindow at_gsd(const MapWindow& map, double gsd_m) {
  const double factor = map.gsd_m / gsd_m;
  if (factor > kWorthShrinking) return map;
  const cv::Size size(static_cast<int>(std::lround(map.image.cols * factor)),
                      static_cast<int>(std::lround(map.image.rows * factor)));
  MapWindow scaled = map;
  scaled.image = area_resized(map.image, size);
  if (cv::countNonZero(map.mask) == map.mask.size().area()) {  // most windows are all map
    scaled.mask = cv::Mat(size, CV_8UC1, cv::Scalar(255));
  } else {
    scaled.mask = area_resized(map.mask, size);
    cv::threshold(scaled.mask, scaled.mask, 254, 255, cv::THRESH_BINARY);
  }
  scaled.gsd_m = map.gsd_m * map.image.cols / size.width;
  return scaled;
}

std::optional<MatchingPlan> matching_plan(const CameraModel& camera, const ZoomRange& zooms, const LocalFrame& frame,
                                          const SearchPrior& prior) {
  const LonLat middle = frame.lonlat_from_plane(prior.pose.position);
  MatchingPlan plan;
  plan.scale = matching_scale(camera, prior.pose.agl_m, ground_resolution_m(zooms.max, middle.lat_deg));
  plan.options.gsd_m = plan.scale.coarse_gsd_m;
  plan.options.distinct_m = std::max(kDistinct_m, kDistinct_px * plan.scale.coarse_gsd_m);
  CameraPose highest = prior.pose;
  highest.agl_m *= 1 + prior.scale_range;
  highest.position = {};
  const auto footprint = footprint_of(camera, highest);
  if (!footprint) return std::nullopt;
  plan.reach_m =
      kReachMargin *
      std::max({hypotenuse(footprint->west_m, footprint->north_m), hypotenuse(footprint->east_m, footprint->north_m),
                hypotenuse(footprint->west_m, footprint->south_m), hypotenuse(footprint->east_m, footprint->south_m)});
  return plan;
}

PlaneBox searched_ground(const CameraModel& camera, const AnchorPrior& prior, const MatchingPlan& plan) {
  const SearchPrior& search = prior.search;
  const double turn_rad = search.heading_range_rad + plan.options.heading_step_rad;
  const double scale = search.scale_range + plan.options.scale_step;
  PlaneBox visible = {plan.reach_m, plan.reach_m, -plan.reach_m, -plan.reach_m};
  const int turns = static_cast<int>(std::ceil(turn_rad / plan.options.heading_step_rad));
  for (int i = -turns; i <= turns; ++i) {
    CameraPose pose = search.pose;
    pose.position = {};
    pose.agl_m *= 1 + scale;
    pose.attitude.heading_rad += i * turn_rad / turns;
    const auto box = footprint_of(camera, pose);
    if (!box) continue;
    visible.west_m = std::min(visible.west_m, box->west_m), visible.east_m = std::max(visible.east_m, box->east_m);
    visible.south_m = std::min(visible.south_m, box->south_m),
    visible.north_m = std::max(visible.north_m, box->north_m);
  }
  const double tilt_rad = kWindowTiltSigmas * std::sqrt(prior.tilt_covariance_rad2.trace() / 2);
  const double margin_m =
      search.radius_m + std::max({kWindowSlack_m, kWindowSlackShare * footprint_side_m(camera, search.pose.agl_m),
                                  std::tan(std::min(tilt_rad, kWindowMaxTilt_rad)) * search.pose.agl_m});
  const PlanePoint& middle = search.pose.position;
  return {middle.east_m + visible.west_m - margin_m, middle.north_m + visible.south_m - margin_m,
          middle.east_m + visible.east_m + margin_m, middle.north_m + visible.north_m + margin_m};
}

AnchorMatch begin_match(const MatchingPlan& plan) {
  AnchorMatch match;
  match.fine_gsd_m = plan.scale.fine_gsd_m;
  match.coarse_gsd_m = plan.scale.coarse_gsd_m;
  return match;
}

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

MatchingScale matching_scale(const CameraModel& camera, double agl_m, double map_gsd_m) {
  const double frame_gsd_m = gsd_at(camera, agl_m);
  const double side_m = frame_gsd_m * std::max(camera.width, camera.height);
  MatchingScale scale;
  scale.fine_gsd_m = std::max({frame_gsd_m, map_gsd_m, side_m / kFineTemplate_px});
  scale.coarse_gsd_m = std::max(scale.fine_gsd_m, side_m / kCoarseTemplate_px);
  return scale;
}

}  // namespace nadir
