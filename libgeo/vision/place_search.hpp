// Where in a map window was this frame taken? A sweep over headings and scales with the two double-angle channels finds
// candidate places; all six channels confirm them.
//
// The ratio of the best score elsewhere (over all headings and scales) to the best score is the gate's main input: on
// real frames right answers have 0.3–0.88 and wrong ones 0.86–1.00.
#pragma once

#include <vector>

#include "base/progress.hpp"
#include "imagery/map_window.hpp"
#include "vision/oriented_channels.hpp"
#include "vision/rectify.hpp"

namespace nadir {

struct SearchPrior {
  CameraPose pose;               // attitude and height to begin with; the position is the middle of the window searched
  double radius_m = 100;         // half the side of the square of camera positions that are searched
  double heading_range_rad = 0;  // ± this around the pose's heading
  double scale_range = 0;        // ± this, relative, around the pose's height
};

struct SearchOptions {
  double gsd_m = 1.0;               // to search at
  double distinct_m = 25;           // places closer than this are one place
  std::size_t candidates = 5;       // places that are confirmed
  double heading_step_rad = 0.052;  // 3 degrees
  double scale_step = 0.04;
  Likeness likeness;
  Cancel cancel;  // asked before each heading and scale
};

struct Place {
  CameraPose pose;
  double score = -1;         // of six channels
  double coarse_score = -1;  // of two channels in the sweep
};

struct SearchResult {
  std::vector<Place> places;  // best first; empty when nothing of the window could be matched
  double ratio = 1;           // second best / best; 1 when there is no second place to compare with or no match
};

// The frame is matched with `map`, a grey window that covers every searched footprint (missing parts are masked) and is
// not coarser than options.gsd_m.
SearchResult search_place(const cv::Mat& grey, const CameraModel& camera, const MapWindow& map,
                          const SearchPrior& prior, const SearchOptions& options);

// The result of several windows' places: the best one, distinct others, and the ratio over all of them.
SearchResult best_of(std::vector<Place> places, const SearchOptions& options);

}  // namespace nadir
