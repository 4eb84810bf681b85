// At which scale and in which windows of the map a frame is searched, whatever is compared there.
#pragma once

#include <optional>
#include <vector>

#include "geodesy/local_frame.hpp"
#include "imagery/tile_source.hpp"
#include "vision/map_matcher.hpp"

namespace nadir {

// The ground sample distances to match at: fine enough for a template of some 400 pixels, never much finer than frame
// or map.
struct MatchingScale {
  double fine_gsd_m = 0.5;
  double coarse_gsd_m = 1.0;
};
MatchingScale matching_scale(const CameraModel& camera, double agl_m, double map_gsd_m);

struct MatchingPlan {
  SearchOptions options;
  MatchingScale scale;
  double reach_m = 0;  // how far from the ground point under the camera a footprint may reach
};

// Nothing when the camera sees the horizon.
std::optional<MatchingPlan> matching_plan(const CameraModel& camera, const ZoomRange& zooms, const LocalFrame& frame,
                                          const SearchPrior& prior);

// An empty match with its scales set.
AnchorMatch begin_match(const MatchingPlan& plan);

// The ground that a frame taken in the searched square may show, with the attitude uncertainty of the prior.
PlaneBox searched_ground(const CameraModel& camera, const AnchorPrior& prior, const MatchingPlan& plan);

// The smallest grid over the box whose pixels are those of the map.
GroundGrid grid_over(const PlaneBox& box, const MapWindow& map);

// The window without the parts beyond the map, except for a margin that a template may overhang.
MapWindow cropped_to_map(const MapWindow& map, double margin_m);

// The same ground at this GSD; as it is where it is about as coarse already.
MapWindow at_gsd(const MapWindow& map, double gsd_m);

// Squares that cover the area, each small enough to be searched at once.
std::vector<SearchPrior> windows_over(const PlaneBox& area, const SearchPrior& prior);

}  // namespace nadir
