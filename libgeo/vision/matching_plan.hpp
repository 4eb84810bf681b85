// At which scale and in which windows of the map a frame is searched, whatever is compared there.
#pragma once

#include <optional>
#include <vector>

#include "geodesy/local_frame.hpp"
#include "geodesy/region.hpp"
#include "imagery/map_window.hpp"
#include "imagery/tile_source.hpp"
#include "vision/anchor_matcher.hpp"

namespace nadir {

struct MatchingPlan {
  SearchOptions options;
  MatchingScale scale;
  double reach_m = 0;  // how far from the camera's foot point a footprint may reach
};

// Nothing when the camera sees the horizon.
std::optional<MatchingPlan> matching_plan(const CameraModel& camera, const ZoomRange& zooms, const LocalFrame& frame,
                                          const SearchPrior& prior);

AnchorMatch begun(const MatchingPlan& plan);

// The ground that a frame taken in the searched square may show, with the attitude no better known than the prior says.
PlaneBox searched_ground(const CameraModel& camera, const AnchorPrior& prior, const MatchingPlan& plan);

PlaneBox square_around(PlanePoint middle, double half_side_m);

// Leaves out what no placement needs: the window beyond the map, but for a rim that a template may overhang.
MapWindow cropped_to_map(const MapWindow& map, double rim_m);

// Squares that cover the area, each small enough to be searched at once.
std::vector<SearchPrior> windows_over(const PlaneBox& area, const SearchPrior& prior);

}  // namespace nadir
