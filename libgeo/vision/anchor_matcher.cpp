#include "vision/anchor_matcher.hpp"

#include <algorithm>
#include <opencv2/core.hpp>

#include "vision/matching_plan.hpp"
#include "vision/pose_refinement.hpp"

namespace nadir {
namespace {

constexpr int kRounds = 3;
constexpr double kRefineSlack_m = 30;

void refine(AnchorMatch& match, const cv::Mat& grey, const CameraModel& camera, const MapWindow& map,
            const AnchorPrior& prior, const GroundSurface& surface, const Likeness& likeness) {
  const CameraPose& begin = match.search.places.front().pose;
  const ReducedFrame frame = reduce_frame(grey, camera, begin.agl_m, map.gsd_m);
  PoseRefinement refinement(camera, prior, begin, map, surface);
  PatchOptions patches;
  patches.likeness = likeness;
  for (int round = 0; round < kRounds; ++round) {
    patches.columns = round == 0 ? 8 : 12;
    patches.rows = round == 0 ? 6 : 8;
    patches.search_px = round == 0 ? 12 : round == 1 ? 8 : 6;
    const auto grid = refinement.grid();
    if (!grid) return;
    const CameraPose pose = refinement.pose();
    const RectifiedFrame rectified = rectify(frame, pose, *grid, surface);
    const PatchMatches found = match_patches(rectified, frame.camera, pose, map, patches, surface);
    if (!refinement.solve(match, found, rectified, pose, round == 0 ? 7.0 : 3.5, patches.patch_px)) return;
  }
}

}  // namespace

AnchorMatch match_anchor(const cv::Mat& grey, const CameraModel& camera, const TileSource& tiles,
                         const LocalFrame& frame, const AnchorPrior& prior, const GroundSurface& surface,
                         const Likeness& likeness) {
  auto plan = matching_plan(camera, tiles, frame, prior.search);
  if (!plan) return {};
  plan->options.likeness = likeness;
  AnchorMatch match = begun(*plan);
  SearchPrior search = prior.search;
  // Without room for other places there is nothing to compare the best one with.
  search.radius_m = std::max(search.radius_m, 2.2 * plan->options.distinct_m);
  const MapWindow window =
      read_map_window(tiles, frame, square_around(search.pose.position, search.radius_m + plan->reach_m),
                      plan->scale.fine_gsd_m, Colour::grey);
  match.on_map = cv::countNonZero(window.mask) > 0;
  if (!match.on_map) return match;
  const MapWindow map = cropped_to_map(window, plan->reach_m / 2);

  match.search = search_place(grey, camera, map, search, plan->options);
  if (!match.search.places.empty()) refine(match, grey, camera, map, prior, surface, likeness);
  return match;
}

AnchorMatch match_anchor_anywhere(const cv::Mat& grey, const CameraModel& camera, const TileSource& tiles,
                                  const LocalFrame& frame, const AnchorPrior& prior, const PlaneBox& area,
                                  const GroundSurface& surface, const Likeness& likeness) {
  auto plan = matching_plan(camera, tiles, frame, prior.search);
  if (!plan) return {};
  plan->options.likeness = likeness;
  AnchorMatch match = begun(*plan);
  match.on_map = false;
  std::vector<Place> places;
  for (const SearchPrior& search : windows_over(area, prior.search)) {
    const MapWindow window =
        read_map_window(tiles, frame, square_around(search.pose.position, search.radius_m + plan->reach_m),
                        plan->scale.coarse_gsd_m, Colour::grey);
    if (cv::countNonZero(window.mask) == 0) continue;
    match.on_map = true;
    const SearchResult found =
        search_place(grey, camera, cropped_to_map(window, plan->reach_m / 2), search, plan->options);
    places.insert(places.end(), found.places.begin(), found.places.end());
  }
  match.search = best_of(std::move(places), plan->options);
  if (match.search.places.empty()) return match;
  AnchorPrior there = prior;
  there.search.pose.position = match.search.places.front().pose.position;
  const MapWindow map =
      read_map_window(tiles, frame, square_around(there.search.pose.position, kRefineSlack_m + plan->reach_m),
                      plan->scale.fine_gsd_m, Colour::grey);
  refine(match, grey, camera, map, there, surface, likeness);
  return match;
}

}  // namespace nadir
