#include "vision/anchor_matcher.hpp"

#include <algorithm>
#include <cmath>
#include <opencv2/core.hpp>

#include "vision/area_search.hpp"
#include "vision/matching_plan.hpp"
#include "vision/pose_refinement.hpp"

namespace nadir {
namespace {

constexpr int kRounds = 3;
constexpr double kRefineSlack_m = 30;
constexpr double kHopelessRatio = 0.90;        // no gate believes more, and rivals only raise it
constexpr std::size_t kRememberedPlaces = 10;  // that are looked at

void refine(AnchorMatch& match, const cv::Mat& grey, const CameraModel& camera, const MapWindow& map,
            const AnchorPrior& prior, const GroundSurface& surface, const Likeness& likeness) {
  const CameraPose& begin = match.search.places.front().pose;
  const ReducedFrame frame = reduce_frame(grey, camera, begin.agl_m, map.gsd_m);
  PoseRefinement refinement(camera, prior, begin, map, surface);
  PatchOptions patches;
  patches.likeness = likeness;
  MapChannels map_channels(map.image, map.mask, likeness.fine, likeness.channels);
  for (int round = 0; round < kRounds; ++round) {
    prior.cancel.check();
    patches.columns = round == 0 ? 8 : 12;
    patches.rows = round == 0 ? 6 : 8;
    patches.search_px = round == 0 ? 12 : round == 1 ? 8 : 6;
    const auto grid = refinement.grid();
    if (!grid) return;
    const CameraPose pose = refinement.pose();
    const RectifiedFrame rectified = rectify(frame, pose, *grid, surface);
    const PatchMatches found = match_patches(rectified, frame.camera, pose, map, map_channels, patches, surface);
    if (!refinement.solve(match, found, rectified, pose, round == 0 ? 7.0 : 3.5, patches.patch_px)) return;
  }
}

std::optional<MatchingPlan> planned(const CameraModel& camera, const MapWindowReader& map, const LocalFrame& frame,
                                    const AnchorPrior& prior, const Likeness& likeness) {
  auto plan = matching_plan(camera, map.zooms(), frame, prior.search);
  if (!plan) return plan;
  plan->options.likeness = likeness;
  plan->options.cancel = prior.cancel;
  return plan;
}

// The best of the places, and what the patches say of it.
AnchorMatch settled(const AreaQuestion& question, const MatchingPlan& plan, AreaAnswer answer, const AnchorPrior& prior,
                    const GroundSurface& surface) {
  AnchorMatch match = begun(plan);
  match.on_map = answer.on_map;
  match.search = best_of(std::move(answer.places), plan.options);
  if (match.search.places.empty()) return match;
  AnchorPrior there = prior;
  there.search.pose.position = match.search.places.front().pose.position;
  const MapWindow window =
      question.map.read(question.frame, square_around(there.search.pose.position, kRefineSlack_m + plan.reach_m),
                        plan.scale.fine_gsd_m, Colour::grey);
  refine(match, question.grey, question.camera, window, there, surface, plan.options.likeness);
  return match;
}

}  // namespace

AnchorMatch match_anchor(const cv::Mat& grey, const CameraModel& camera, MapWindowReader& map, const LocalFrame& frame,
                         const AnchorPrior& prior, const GroundSurface& surface, const Likeness& likeness) {
  const auto plan = planned(camera, map, frame, prior, likeness);
  if (!plan) return {};
  AnchorMatch match = begun(*plan);
  AnchorPrior wide = prior;
  // Without room for other places there is nothing to compare the best one with.
  wide.search.radius_m = std::max(prior.search.radius_m, 2.2 * plan->options.distinct_m);
  const MapWindow window = map.read(frame, searched_ground(camera, wide, *plan), plan->scale.fine_gsd_m, Colour::grey);
  match.on_map = cv::countNonZero(window.mask) > 0;
  if (!match.on_map) return match;
  const MapWindow cropped = cropped_to_map(window, plan->reach_m / 2);

  match.search = search_place(grey, camera, cropped, wide.search, plan->options);
  if (!match.search.places.empty()) refine(match, grey, camera, cropped, prior, surface, likeness);
  return match;
}

AnchorMatch match_anchor_anywhere(const cv::Mat& grey, const CameraModel& camera, MapWindowReader& map,
                                  const LocalFrame& frame, const AnchorPrior& prior, const PlaneBox& area,
                                  const GroundSurface& surface, const Likeness& likeness) {
  const auto plan = planned(camera, map, frame, prior, likeness);
  if (!plan) return {};
  const AreaQuestion question{grey, camera, map, frame, prior.search, plan->options, plan->reach_m};
  return settled(question, *plan, search_windows(question, windows_over(area, prior.search)), prior, surface);
}

AnchorMatch match_anchor_among(const cv::Mat& grey, const CameraModel& camera, MapWindowReader& map,
                               const LocalFrame& frame, const AnchorPrior& prior, const PlaneBox& area,
                               const PlaceSuggestions& suggested, const GroundSurface& surface,
                               const Likeness& likeness) {
  const auto plan = planned(camera, map, frame, prior, likeness);
  if (!plan) return {};
  const AreaQuestion question{grey, camera, map, frame, prior.search, plan->options, plan->reach_m};
  AreaAnswer answer;
  if (suggested.hint) answer = search_windows(question, windows_over(*suggested.hint, prior.search));
  if (suggested.memory != nullptr) {
    const AreaAnswer more = search_remembered(question, *suggested.memory, area, kRememberedPlaces);
    answer.on_map = answer.on_map || more.on_map;
    answer.places.insert(answer.places.end(), more.places.begin(), more.places.end());
  }
  AnchorMatch match = settled(question, *plan, answer, prior, surface);
  if (!match.solved || match.search.ratio > kHopelessRatio) return match;
  // It may only be believed if nothing else in all of the area is like it.
  const std::vector<Place> others = rivals(question, area, match.search.places.front());
  const PlanePoint found = match.search.places.front().pose.position;
  answer.places.insert(answer.places.end(), others.begin(), others.end());
  SearchResult all = best_of(answer.places, plan->options);
  const PlanePoint best = all.places.front().pose.position;
  if (std::hypot(best.east_m - found.east_m, best.north_m - found.north_m) >= plan->options.distinct_m) {
    return settled(question, *plan, std::move(answer), prior, surface);
  }
  match.search = std::move(all);
  return match;
}

}  // namespace nadir
