#include <algorithm>
#include <cmath>
#include <opencv2/core.hpp>

#include "vision/matching_plan.hpp"
#include "vision/place_matcher.hpp"
#include "vision/pose_refinement.hpp"
#include "vision/sift_places.hpp"

namespace nadir {
namespace {

constexpr int kMostFrameFeatures = 1500, kMostMapFeatures = 12000;
constexpr int kWidestWindow_px = 1700;  // a wider window is looked at in coarser pixels
constexpr double kGuidedReach_px = 12;
constexpr double kKeypointSigma_px = 0.8;
constexpr double kFeature_px = 24;  // the ground that a feature stands for

class SiftMatcher final : public MapMatcher {
 public:
  explicit SiftMatcher(const MatcherMap& map) : map_(map) {}

  AnchorMatch match(const cv::Mat& grey, const AnchorPrior& prior) override {
    return match_in(grey, prior, {prior.search});
  }

  AnchorMatch match_anywhere(const cv::Mat& grey, const AnchorPrior& prior, const PlaneBox& area) override {
    return match_in(grey, prior, windows_over(area, prior.search));
  }

 private:
  AnchorMatch match_in(const cv::Mat& grey, const AnchorPrior& prior, const std::vector<SearchPrior>& windows) const {
    const auto plan = matching_plan(map_.camera, map_.tiles.zooms(), map_.frame, prior.search);
    if (!plan) return {};
    AnchorMatch match = begun(*plan);
    match.on_map = false;
    SiftPlaces all;
    for (const SearchPrior& search : windows) {
      prior.cancel.check();
      const double half_m = search.radius_m + plan->reach_m;
      const double gsd_m = std::max(plan->scale.fine_gsd_m, 2 * half_m / kWidestWindow_px);
      const MapWindow window =
          read_map_window(map_.tiles, map_.frame, square_around(search.pose.position, half_m), gsd_m, Colour::grey);
      if (cv::countNonZero(window.mask) == 0) continue;
      match.on_map = true;
      const SiftPlaces found = search_window(grey, search, window, plan->options.distinct_m);
      all.places.insert(all.places.end(), found.places.begin(), found.places.end());
      all.chance = std::max(all.chance, found.chance);
    }
    match.search = best_of(std::move(all.places), plan->options);
    const std::vector<Place>& places = match.search.places;
    if (places.empty()) return match;
    const double elsewhere = std::max(all.chance, places.size() > 1 ? places[1].score : 0);
    match.search.ratio = std::min(1.0, elsewhere / places[0].score);
    refine(match, grey, prior, *plan);
    return match;
  }

  SiftPlaces search_window(const cv::Mat& grey, const SearchPrior& search, const MapWindow& window,
                           double distinct_m) const {
    const auto box = footprint_of(map_.camera, search.pose);
    if (!box) return {};
    GroundGrid grid{box->west_m, box->north_m, window.gsd_m, 0, 0};
    grid.columns = static_cast<int>(std::ceil((box->east_m - box->west_m) / grid.gsd_m));
    grid.rows = static_cast<int>(std::ceil((box->north_m - box->south_m) / grid.gsd_m));
    const RectifiedFrame frame =
        rectify(reduce_frame(grey, map_.camera, search.pose.agl_m, grid.gsd_m), search.pose, grid, map_.surface);
    const SiftPairs pairs = sift_pairs(sift_features(frame.image, frame.mask, kMostFrameFeatures),
                                       sift_features(window.image, window.mask, kMostMapFeatures));
    return sift_places(pairs, frame, window, search, distinct_m);
  }

  // With the place known, features have few others to be mistaken for: twice, the second time with the pose solved.
  void refine(AnchorMatch& match, const cv::Mat& grey, const AnchorPrior& prior, const MatchingPlan& plan) const {
    constexpr double kSlack_m = 30;
    AnchorPrior there = prior;
    const CameraPose& begin = match.search.places.front().pose;
    there.search.pose.position = begin.position;
    const MapWindow map =
        read_map_window(map_.tiles, map_.frame, square_around(begin.position, kSlack_m + plan.reach_m),
                        plan.scale.fine_gsd_m, Colour::grey);
    const SiftFeatures on_map = sift_features(map.image, map.mask, kMostMapFeatures);
    PoseRefinement refinement(map_.camera, there, begin, map, map_.surface);
    const ReducedFrame frame = reduce_frame(grey, map_.camera, begin.agl_m, map.gsd_m);
    for (const double inlier_px : {7.0, 3.5}) {
      const auto grid = refinement.grid();
      if (!grid) return;
      const CameraPose pose = refinement.pose();
      const RectifiedFrame rectified = rectify(frame, pose, *grid, map_.surface);
      const SiftPairs pairs = sift_pairs(sift_features(rectified.image, rectified.mask, kMostFrameFeatures), on_map);
      if (!refinement.solve(match, near_pairs(pairs, rectified, map), rectified, pose, inlier_px, kFeature_px)) return;
    }
  }

  static PatchMatches near_pairs(const SiftPairs& pairs, const RectifiedFrame& frame, const MapWindow& map) {
    PatchMatches near;
    near.tried = static_cast<int>(pairs.frame.size());
    const double sigma_m = kKeypointSigma_px * map.gsd_m;
    for (std::size_t i = 0; i < pairs.frame.size(); ++i) {
      PatchMatch match;
      match.in_frame = plane_of(frame.grid, pairs.frame[i]);
      match.on_map = plane_of(map, pairs.map[i]);
      const double off_m =
          std::hypot(match.on_map.east_m - match.in_frame.east_m, match.on_map.north_m - match.in_frame.north_m);
      if (off_m > kGuidedReach_px * map.gsd_m) continue;
      match.score = 1;
      match.information_m2 = Eigen::Matrix2d::Identity() / (sigma_m * sigma_m);
      near.found.push_back(match);
    }
    return near;
  }

  MatcherMap map_;
};

}  // namespace

std::unique_ptr<MapMatcher> make_sift_matcher(const MatcherMap& map) { return std::make_unique<SiftMatcher>(map); }

}  // namespace nadir
