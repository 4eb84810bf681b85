#include "bench/keypoint_matcher.hpp"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <limits>
#include <opencv2/calib3d.hpp>
#include <opencv2/core.hpp>
#include <opencv2/features2d.hpp>
#include <opencv2/imgproc.hpp>
#include <optional>
#include <utility>
#include <vector>

#include "geodesy/angles.hpp"
#include "vision/feature_matching.hpp"
#include "vision/map_search.hpp"
#include "vision/matching_plan.hpp"
#include "vision/pose_refinement.hpp"

namespace nadir {
namespace {

constexpr double kSiftContrast = 0.01;
constexpr double kMatchRatio = 0.85;
constexpr double kThreshold_px = 3.0;
constexpr std::size_t kMinAgreeing = 6;                    // four fit a homography whatever they are
constexpr double kMoreScale = 0.06, kMoreTurn_rad = 0.12;  // than the prior's ranges: measured, not assumed
constexpr int kMaxFrameFeatures = 1500, kMaxMapFeatures = 12000;
constexpr int kWidestWindow_px = 1700;  // a wider window is searched in coarser pixels
constexpr double kGuidedReach_px = 12;
constexpr double kKeypointSigma_px = 0.8;
constexpr double kFeature_px = 24;  // the ground that a feature stands for

// The same points in the rectified frame and in the map window, in pixels. Many of them may be wrong.
struct PointPairs {
  std::vector<cv::Point2f> frame, map;
};

struct KeypointHypotheses {
  std::vector<MatchHypothesis> places;  // the score is the share of the pairs that agree
  double chance = 0;                    // the score that any place reaches
};

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

// The camera pose that the homography implies, or nothing when no camera near the prior could see so.
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

std::optional<Agreement> agreement_of(const PointPairs& pairs, const RectifiedFrame& frame, const MapWindow& map,
                                      const SearchPrior& prior) {
  if (pairs.frame.size() < kMinAgreeing) return std::nullopt;
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
  if (!pose || agreement.count < kMinAgreeing) return std::nullopt;
  agreement.pose = *pose;
  return agreement;
}

MatchHypothesis hypothesis_of(const Agreement& agreement, std::size_t pairs) {
  MatchHypothesis hypothesis;
  hypothesis.pose = agreement.pose;
  hypothesis.score = hypothesis.coarse_score = static_cast<double>(agreement.count) / static_cast<double>(pairs);
  return hypothesis;
}

class Sift final : public KeypointBackend {
 public:
  KeypointSet find(const cv::Mat& grey, const cv::Mat& mask, int most) override {
    KeypointSet found;
    std::vector<cv::KeyPoint> points;
    cv::Mat inner;
    cv::erode(mask, inner, cv::getStructuringElement(cv::MORPH_RECT, {9, 9}), {-1, -1}, 1, cv::BORDER_CONSTANT,
              cv::Scalar(255));
    cv::SIFT::create(most, 3, kSiftContrast)->detectAndCompute(grey, inner, points, found.descriptors);
    cv::KeyPoint::convert(points, found.points);
    return found;
  }
  std::vector<FeatureMatch> pairs(const KeypointSet& frame, const KeypointSet& map) override {
    return unambiguous_matches(FeatureDescriptors(frame.descriptors), FeatureDescriptors(map.descriptors), kMatchRatio);
  }
  double most_frame_px() const override { return std::numeric_limits<double>::infinity(); }
};

// OpenCV's pixels: the centre of one has whole numbers.
PlanePoint plane_of(const GroundGrid& grid, const cv::Point2f& pixel) {
  return grid.plane_from_pixel(static_cast<double>(pixel.x) + 0.5, static_cast<double>(pixel.y) + 0.5);
}

PlanePoint plane_of(const MapWindow& map, const cv::Point2f& pixel) {
  return map.plane_from_pixel(static_cast<double>(pixel.x) + 0.5, static_cast<double>(pixel.y) + 0.5);
}

// The place that most pairs agree on, and the one that most of those agree on that support another place. `frame` was
// rectified with the prior's pose; a place lies within the prior's window.
KeypointHypotheses keypoint_hypotheses(const PointPairs& pairs, const RectifiedFrame& frame, const MapWindow& map,
                                       const SearchPrior& prior, double distinct_m) {
  KeypointHypotheses found;
  const auto best = agreement_of(pairs, frame, map, prior);
  if (!best) return found;
  found.chance = static_cast<double>(kMinAgreeing) / static_cast<double>(pairs.frame.size());
  found.places.push_back(hypothesis_of(*best, pairs.frame.size()));
  const Eigen::Vector2d moved(best->pose.position.east_m - prior.pose.position.east_m,
                              best->pose.position.north_m - prior.pose.position.north_m);
  PointPairs others;
  for (std::size_t i = 0; i < pairs.frame.size(); ++i) {
    const PlanePoint from = plane_of(frame.grid, pairs.frame[i]);
    const PlanePoint to = plane_of(map, pairs.map[i]);
    const Eigen::Vector2d shift(to.east_m - from.east_m, to.north_m - from.north_m);
    if (best->agrees[i] || (shift - moved).norm() < distinct_m) continue;
    others.frame.push_back(pairs.frame[i]);
    others.map.push_back(pairs.map[i]);
  }
  if (const auto other = agreement_of(others, frame, map, prior)) {
    found.places.push_back(hypothesis_of(*other, pairs.frame.size()));
  }
  return found;
}

class KeypointMatcher final : public MapMatcher {
 public:
  KeypointMatcher(const MatcherMap& map, std::shared_ptr<KeypointBackend> backend)
      : map_(map), backend_(std::move(backend)) {}

  AnchorMatch match(const cv::Mat& grey, const AnchorPrior& prior) override {
    return match_in(grey, prior, {prior.search});
  }

  AnchorMatch match_anywhere(const cv::Mat& grey, const AnchorPrior& prior, const PlaneBox& area) override {
    return match_in(grey, prior, windows_over(area, prior.search));
  }

 private:
  AnchorMatch match_in(const cv::Mat& grey, const AnchorPrior& prior, const std::vector<SearchPrior>& windows) const {
    auto plan = matching_plan(map_.camera, map_.tiles.zooms(), map_.frame, prior.search);
    if (!plan) return {};
    plan->scale.fine_gsd_m = std::max(
        plan->scale.fine_gsd_m, footprint_side_m(map_.camera, prior.search.pose.agl_m) / backend_->most_frame_px());
    AnchorMatch match = begin_match(*plan);
    match.on_map = false;
    KeypointHypotheses all;
    for (const SearchPrior& search : windows) {
      prior.cancel.check();
      const double half_m = search.radius_m + plan->reach_m;
      const double gsd_m = std::max(plan->scale.fine_gsd_m, 2 * half_m / kWidestWindow_px);
      const MapWindow window =
          read_map_window(map_.tiles, map_.frame, square_around(search.pose.position, half_m), gsd_m, Colour::grey);
      if (cv::countNonZero(window.mask) == 0) continue;
      match.on_map = true;
      const KeypointHypotheses found = search_window(grey, search, window, plan->options.distinct_m);
      all.places.insert(all.places.end(), found.places.begin(), found.places.end());
      all.chance = std::max(all.chance, found.chance);
    }
    match.search = best_of(std::move(all.places), plan->options);
    const std::vector<MatchHypothesis>& places = match.search.places;
    if (places.empty()) return match;
    const double elsewhere = std::max(all.chance, places.size() > 1 ? places[1].score : 0);
    match.search.ratio = std::min(1.0, elsewhere / places[0].score);
    refine(match, grey, prior, *plan);
    return match;
  }

  KeypointHypotheses search_window(const cv::Mat& grey, const SearchPrior& search, const MapWindow& window,
                                   double distinct_m) const {
    const auto box = footprint_of(map_.camera, search.pose);
    if (!box) return {};
    GroundGrid grid{box->west_m, box->north_m, window.gsd_m, 0, 0};
    grid.columns = static_cast<int>(std::ceil((box->east_m - box->west_m) / grid.gsd_m));
    grid.rows = static_cast<int>(std::ceil((box->north_m - box->south_m) / grid.gsd_m));
    const RectifiedFrame frame =
        rectify(reduce_frame(grey, map_.camera, search.pose.agl_m, grid.gsd_m), search.pose, grid, map_.surface);
    const PointPairs pairs = paired(backend_->find(frame.image, frame.mask, kMaxFrameFeatures),
                                    backend_->find(window.image, window.mask, kMaxMapFeatures));
    return keypoint_hypotheses(pairs, frame, window, search, distinct_m);
  }

  // Near a known place few features can be confused: twice, the second time with the solved pose.
  void refine(AnchorMatch& match, const cv::Mat& grey, const AnchorPrior& prior, const MatchingPlan& plan) const {
    constexpr double kSlack_m = 30;
    AnchorPrior there = prior;
    const CameraPose& begin = match.search.places.front().pose;
    there.search.pose.position = begin.position;
    const MapWindow map =
        read_map_window(map_.tiles, map_.frame, square_around(begin.position, kSlack_m + plan.reach_m),
                        plan.scale.fine_gsd_m, Colour::grey);
    const KeypointSet on_map = backend_->find(map.image, map.mask, kMaxMapFeatures);
    PoseRefinement refinement(map_.camera, there, begin, map, map_.surface);
    const ReducedFrame frame = reduce_frame(grey, map_.camera, begin.agl_m, map.gsd_m);
    for (const double inlier_px : {7.0, 3.5}) {
      const auto grid = refinement.grid();
      if (!grid) return;
      const CameraPose pose = refinement.pose();
      const RectifiedFrame rectified = rectify(frame, pose, *grid, map_.surface);
      const PointPairs pairs = paired(backend_->find(rectified.image, rectified.mask, kMaxFrameFeatures), on_map);
      if (!refinement.solve(match, near_pairs(pairs, rectified, map), rectified, pose, inlier_px, kFeature_px)) return;
    }
  }

  PointPairs paired(const KeypointSet& frame, const KeypointSet& map) const {
    PointPairs pairs;
    for (const FeatureMatch& match : backend_->pairs(frame, map)) {
      pairs.frame.push_back(frame.points[match.first]);
      pairs.map.push_back(map.points[match.second]);
    }
    return pairs;
  }

  static PatchMatches near_pairs(const PointPairs& pairs, const RectifiedFrame& frame, const MapWindow& map) {
    PatchMatches near;
    near.tried = static_cast<int>(pairs.frame.size());
    const double sigma_m = kKeypointSigma_px * map.gsd_m;
    for (std::size_t i = 0; i < pairs.frame.size(); ++i) {
      PatchMatch match;
      match.in_frame = plane_of(frame.grid, pairs.frame[i]);
      match.on_map = plane_of(map, pairs.map[i]);
      const double off_m = distance_m(match.on_map, match.in_frame);
      if (off_m > kGuidedReach_px * map.gsd_m) continue;
      match.score = 1;
      match.information_m2 = Eigen::Matrix2d::Identity() / (sigma_m * sigma_m);
      near.found.push_back(match);
    }
    return near;
  }

  MatcherMap map_;
  std::shared_ptr<KeypointBackend> backend_;
};

}  // namespace

std::unique_ptr<MapMatcher> make_keypoint_matcher(const MatcherMap& map, std::shared_ptr<KeypointBackend> backend) {
  return std::make_unique<KeypointMatcher>(map, std::move(backend));
}

std::unique_ptr<MapMatcher> make_sift_matcher(const MatcherMap& map) {
  return make_keypoint_matcher(map, std::make_shared<Sift>());
}

}  // namespace nadir
