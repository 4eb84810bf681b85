#include "vision/map_matcher.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <opencv2/core.hpp>
#include <utility>

#include "vision/matching_plan.hpp"
#include "vision/pose_refinement.hpp"

namespace nadir {
namespace {

struct RefinementPatches {
  int side_px;
  double min_score;  // correlation below this is no match
  std::array<RefinementRound, 3> rounds;
};
constexpr RefinementPatches kFinePatches{kPatch_px, kMinPatchScore, kRefinementRounds};
constexpr RefinementPatches kCoarsePatches{kCoarsePatch_px, kMinCoarsePatchScore, kCoarseRounds};

class ChannelMatcher final : public MapMatcher {
 public:
  ChannelMatcher(const MatcherMap& map, const MatchFeatures& features)
      : map_(map), reader_(map.tiles, kCachedMapTiles), features_(features) {}

  AnchorMatch match(const cv::Mat& grey, const AnchorPrior& prior) override {
    const auto plan = plan_for(prior);
    if (!plan) return {};
    AnchorMatch match = begin_match(*plan);
    AnchorPrior wide = prior;
    // Without room for other places there is nothing to compare the best one with.
    wide.search.radius_m = std::max(prior.search.radius_m, kMinWindowDistinct * plan->options.distinct_m);
    const MapWindow window =
        reader_.read(map_.frame, searched_ground(map_.camera, wide, *plan), plan->scale.fine_gsd_m, Colour::grey);
    match.on_map = cv::countNonZero(window.mask) > 0;
    if (!match.on_map) return match;
    const MapWindow cropped = cropped_to_map(window, plan->reach_m / 2);

    match.search = search_window(grey, map_.camera, cropped, wide.search, plan->options);
    if (!match.search.places.empty()) refine(match, grey, cropped, prior);
    state_map_error(match, *plan);
    return match;
  }

  AnchorMatch match_anywhere(const cv::Mat& grey, const AnchorPrior& prior, const PlaneBox& area) override {
    const auto plan = plan_for(prior);
    if (!plan) return {};
    const AreaQuery query = area_query(grey, prior, *plan);
    return refine_best(query, *plan, search_windows(query, windows_over(area, prior.search)), prior);
  }

  AnchorMatch match_among(const cv::Mat& grey, const AnchorPrior& prior, const PlaneBox& area,
                          const SearchSuggestions& suggested) override {
    const auto plan = plan_for(prior);
    if (!plan) return {};
    const AreaQuery query = area_query(grey, prior, *plan);
    AreaHypotheses found;
    if (suggested.hint) found = search_windows(query, windows_over(*suggested.hint, prior.search));
    if (suggested.retrieval != nullptr) {
      const AreaHypotheses more = search_retrieved(query, *suggested.retrieval, area, kRetrievedPlaces);
      found.on_map = found.on_map || more.on_map;
      found.places.insert(found.places.end(), more.places.begin(), more.places.end());
    }
    AnchorMatch match = refine_best(query, *plan, found, prior);
    if (!match.solved || match.search.ratio > kHopelessRatio) return match;
    // It may only be accepted if nothing else in the area looks like it.
    const std::vector<MatchHypothesis> others = rivals(query, area, match.search.places.front());
    const PlanePoint best_suggested = match.search.places.front().pose.position;
    found.places.insert(found.places.end(), others.begin(), others.end());
    SearchResult all = best_of(found.places, plan->options);
    const PlanePoint best = all.places.front().pose.position;
    if (distance_m(best, best_suggested) >= plan->options.distinct_m) {
      return refine_best(query, *plan, std::move(found), prior);
    }
    match.search = std::move(all);
    return match;
  }

 private:
  std::optional<MatchingPlan> plan_for(const AnchorPrior& prior) const {
    auto plan = matching_plan(map_.camera, reader_.zooms(), map_.frame, prior.search);
    if (!plan) return plan;
    plan->options.features = features_;
    plan->options.cancel = prior.cancel;
    return plan;
  }

  AreaQuery area_query(const cv::Mat& grey, const AnchorPrior& prior, const MatchingPlan& plan) {
    return {grey, map_.camera, reader_, map_.frame, prior.search, plan.options, plan.reach_m};
  }

  // The best of the hypotheses, and the evaluation of its patches.
  AnchorMatch refine_best(const AreaQuery& query, const MatchingPlan& plan, AreaHypotheses found,
                          const AnchorPrior& prior) {
    AnchorMatch match = begin_match(plan);
    match.on_map = found.on_map;
    match.search = best_of(std::move(found.places), plan.options);
    if (match.search.places.empty()) return match;
    AnchorPrior there = prior;
    there.search.pose.position = match.search.places.front().pose.position;
    const MapWindow window =
        reader_.read(map_.frame, square_around(there.search.pose.position, kRefinementSlack_m + plan.reach_m),
                     plan.scale.fine_gsd_m, Colour::grey);
    refine(match, query.grey, window, there);
    state_map_error(match, plan);
    return match;
  }

  // One coarse scene of a package does not affect the others: only the tiles that the frame shows count.
  void state_map_error(AnchorMatch& match, const MatchingPlan& plan) const {
    if (!match.solved) return;
    match.map_ce90_m =
        reader_.ce90_m(map_.frame, square_around(match.solved->pose.position, plan.reach_m), plan.scale.fine_gsd_m);
  }

  // Small patches see what is small, and over woods and fields little of that lasts from one year to the next. Where
  // they agree on nothing, larger ones are tried at half the resolution: they see the borders of woods and fields.
  void refine(AnchorMatch& match, const cv::Mat& grey, const MapWindow& map, const AnchorPrior& prior) const {
    if (refine_by(kFinePatches, match, grey, map, prior)) return;
    const MapWindow coarse = at_gsd(map, kCoarsePatchReduction * map.gsd_m);
    match.fine_gsd_m = coarse.gsd_m;
    refine_by(kCoarsePatches, match, grey, coarse, prior);
  }

  // Patches, then the pose from them, then patches again with that pose. False: no pose.
  bool refine_by(const RefinementPatches& patches, AnchorMatch& match, const cv::Mat& grey, const MapWindow& map,
                 const AnchorPrior& prior) const {
    const CameraPose& begin = match.search.places.front().pose;
    const ReducedFrame frame = reduce_frame(grey, map_.camera, begin.agl_m, map.gsd_m);
    PoseRefinement refinement(map_.camera, prior, begin, map, map_.surface);
    MapChannels map_channels(map.image, map.mask, features_.fine, features_.channels);
    for (const RefinementRound& round : patches.rounds) {
      prior.cancel.check();
      const auto grid = refinement.grid();
      if (!grid) break;
      PatchOptions options;
      options.features = features_;
      options.patch_px = patches.side_px;
      options.min_score = patches.min_score;
      options.columns = round.columns;
      options.rows = round.rows;
      options.search_px = round.search_px;
      const CameraPose pose = refinement.pose();
      const RectifiedFrame rectified = rectify(frame, pose, *grid, map_.surface);
      const PatchMatches found = match_patches(rectified, frame.camera, pose, map, map_channels, options, map_.surface);
      if (!refinement.solve(match, found, rectified, pose, round.inlier_px, options.patch_px)) break;
    }
    return match.solved.has_value();
  }

  MatcherMap map_;
  MapWindowReader reader_;  // its tiles serve the next attempt as well
  MatchFeatures features_;
};

}  // namespace

std::unique_ptr<MapMatcher> make_channel_matcher(const MatcherMap& map) { return make_channel_matcher_with(map, {}); }

std::unique_ptr<MapMatcher> make_channel_matcher_with(const MatcherMap& map, const MatchFeatures& features) {
  return std::make_unique<ChannelMatcher>(map, features);
}

}  // namespace nadir
