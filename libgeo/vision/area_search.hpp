// Where in a whole area was this frame taken? Correlating all of it over all headings and heights costs much; looking
// only where somebody suggests, and then all over the area for rivals of what was found there, costs little.
#pragma once

#include <optional>
#include <vector>

#include "geodesy/local_frame.hpp"
#include "geodesy/region.hpp"
#include "imagery/map_window.hpp"
#include "vision/place_memory.hpp"
#include "vision/place_search.hpp"

namespace nadir {

// A frame, and the map that it is looked for in.
struct AreaQuestion {
  const cv::Mat& grey;
  const CameraModel& camera;
  MapWindowReader& map;
  const LocalFrame& frame;
  SearchPrior prior;  // its position is not used
  SearchOptions options;
  double reach_m = 0;  // how far from the camera's foot point a footprint may reach
};

struct AreaAnswer {
  std::vector<Place> places;  // of all windows; best_of() sorts them
  bool on_map = false;        // some window holds map
};

AreaAnswer search_windows(const AreaQuestion& question, const std::vector<SearchPrior>& windows);

// Around the `count` places that look most like the frame to the memory.
AreaAnswer search_remembered(const AreaQuestion& question, const PlaceRetrieval& memory, const PlaneBox& area,
                             std::size_t count);

// What else in the area looks like the frame under the heading and the height of `found`: the places with which it must
// be compared when only suggested windows were searched.
std::vector<Place> rivals(const AreaQuestion& question, const PlaneBox& area, const Place& found);

}  // namespace nadir
