#include "vision/sift_places.hpp"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <opencv2/calib3d.hpp>
#include <opencv2/features2d.hpp>
#include <opencv2/imgproc.hpp>
#include <optional>

#include "geodesy/angles.hpp"

namespace nadir {
namespace {

constexpr double kLeastContrast = 0.01;
constexpr double kMatchRatio = 0.85;
constexpr double kThreshold_px = 3.0;
constexpr std::size_t kLeastAgreeing = 6;                  // four fit a homography whatever they are
constexpr double kMoreScale = 0.06, kMoreTurn_rad = 0.12;  // than the prior's ranges: found out, not believed

cv::Point2d through(const cv::Matx33d& homography, double x, double y) {
  const cv::Vec3d at = homography * cv::Vec3d(x, y, 1);
  return {at[0] / at[2], at[1] / at[2]};
}

// One place that some of the pairs agree on.
struct Agreement {
  CameraPose pose;
  std::vector<bool> agrees;  // per pair
  std::size_t count = 0;
};

// What the homography says of the camera, or nothing when it says what no camera near the prior could see.
std::optional<CameraPose> pose_through(const cv::Matx33d& homography, const RectifiedFrame& frame, const MapWindow& map,
                                       const SearchPrior& prior) {
  const GroundGrid& grid = frame.grid;
  const auto onto_map = [&](PlanePoint point) {
    const cv::Point2d pixel = through(homography, (point.east_m - grid.west_m) / grid.gsd_m - 0.5,
                                      (grid.north_m - point.north_m) / grid.gsd_m - 0.5);
    return map.plane_from_pixel(pixel.x + 0.5, pixel.y + 0.5);
  };
  const PlanePoint middle = grid.plane_from_pixel(grid.columns / 2.0, grid.rows / 2.0);
  const double arm_m = grid.gsd_m * std::min(grid.columns, grid.rows) / 4;
  const PlanePoint to = onto_map(middle), east = onto_map({middle.east_m + arm_m, middle.north_m}),
                   north = onto_map({middle.east_m, middle.north_m + arm_m});
  Eigen::Matrix2d turn;
  turn << east.east_m - to.east_m, north.east_m - to.east_m, east.north_m - to.north_m, north.north_m - to.north_m;
  turn /= arm_m;
  const double scale = std::sqrt(std::abs(turn.determinant()));
  const double left_rad = std::atan2(turn(1, 0) - turn(0, 1), turn(0, 0) + turn(1, 1));
  if (!turn.allFinite() || turn.determinant() <= 0 || std::abs(scale - 1) > prior.scale_range + kMoreScale ||
      std::abs(left_rad) > prior.heading_range_rad + kMoreTurn_rad) {
    return std::nullopt;
  }
  CameraPose pose = prior.pose;
  pose.position = onto_map(pose.position);
  pose.agl_m *= scale;
  pose.attitude.heading_rad = wrap_pi(pose.attitude.heading_rad - left_rad);
  if (std::abs(pose.position.east_m - prior.pose.position.east_m) > prior.radius_m ||
      std::abs(pose.position.north_m - prior.pose.position.north_m) > prior.radius_m) {
    return std::nullopt;
  }
  return pose;
}

std::optional<Agreement> agreement_of(const SiftPairs& pairs, const RectifiedFrame& frame, const MapWindow& map,
                                      const SearchPrior& prior) {
  if (pairs.frame.size() < kLeastAgreeing) return std::nullopt;
  std::vector<std::uint8_t> inlier;
  const cv::Mat homography =
      cv::findHomography(pairs.frame, pairs.map, cv::USAC_MAGSAC, kThreshold_px, inlier, 5000, 0.999);
  if (homography.empty()) return std::nullopt;
  Agreement agreement;
  for (const std::uint8_t in : inlier) {
    agreement.agrees.push_back(in != 0);
    agreement.count += in != 0 ? 1U : 0U;
  }
  const auto pose = pose_through(cv::Matx33d(homography), frame, map, prior);
  if (!pose || agreement.count < kLeastAgreeing) return std::nullopt;
  agreement.pose = *pose;
  return agreement;
}

Place place_of(const Agreement& agreement, std::size_t pairs) {
  Place place;
  place.pose = agreement.pose;
  place.score = place.coarse_score = static_cast<double>(agreement.count) / static_cast<double>(pairs);
  return place;
}

}  // namespace

SiftFeatures sift_features(const cv::Mat& grey, const cv::Mat& mask, int most) {
  SiftFeatures features;
  cv::Mat descriptors, inner;
  cv::erode(mask, inner, cv::getStructuringElement(cv::MORPH_RECT, {9, 9}), {-1, -1}, 1, cv::BORDER_CONSTANT,
            cv::Scalar(255));
  cv::SIFT::create(most, 3, kLeastContrast)->detectAndCompute(grey, inner, features.points, descriptors);
  features.descriptors = FeatureDescriptors(descriptors);
  return features;
}

SiftPairs sift_pairs(const SiftFeatures& frame, const SiftFeatures& map) {
  SiftPairs pairs;
  for (const FeatureMatch& match : unambiguous_matches(frame.descriptors, map.descriptors, kMatchRatio)) {
    pairs.frame.push_back(frame.points[match.first].pt);
    pairs.map.push_back(map.points[match.second].pt);
  }
  return pairs;
}

PlanePoint plane_of(const GroundGrid& grid, const cv::Point2f& pixel) {
  return grid.plane_from_pixel(static_cast<double>(pixel.x) + 0.5, static_cast<double>(pixel.y) + 0.5);
}

PlanePoint plane_of(const MapWindow& map, const cv::Point2f& pixel) {
  return map.plane_from_pixel(static_cast<double>(pixel.x) + 0.5, static_cast<double>(pixel.y) + 0.5);
}

SiftPlaces sift_places(const SiftPairs& pairs, const RectifiedFrame& frame, const MapWindow& map,
                       const SearchPrior& prior, double distinct_m) {
  SiftPlaces found;
  const auto best = agreement_of(pairs, frame, map, prior);
  if (!best) return found;
  found.chance = static_cast<double>(kLeastAgreeing) / static_cast<double>(pairs.frame.size());
  found.places.push_back(place_of(*best, pairs.frame.size()));
  const Eigen::Vector2d moved(best->pose.position.east_m - prior.pose.position.east_m,
                              best->pose.position.north_m - prior.pose.position.north_m);
  SiftPairs others;
  for (std::size_t i = 0; i < pairs.frame.size(); ++i) {
    const PlanePoint from = plane_of(frame.grid, pairs.frame[i]);
    const PlanePoint to = plane_of(map, pairs.map[i]);
    const Eigen::Vector2d shift(to.east_m - from.east_m, to.north_m - from.north_m);
    if (best->agrees[i] || (shift - moved).norm() < distinct_m) continue;
    others.frame.push_back(pairs.frame[i]);
    others.map.push_back(pairs.map[i]);
  }
  if (const auto other = agreement_of(others, frame, map, prior)) {
    found.places.push_back(place_of(*other, pairs.frame.size()));
  }
  return found;
}

}  // namespace nadir
