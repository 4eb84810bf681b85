// Where on the map was this frame taken? Searched in one window, or in a whole area.
//
// In a window: a sweep over headings and scales with the two double-angle channels finds candidates; all six channels
// confirm them. The ratio of the best score elsewhere (over all headings and scales) to the best score is the main
// input of the acceptance: on real frames right answers have 0.3-0.88 and wrong ones 0.86-1.00. Around its best
// candidates the sweep may see several peaks that are one place by distance, and yet farther apart than patches reach:
// rows of fields that look alike. They are confirmed as well, because the sweep may have the wrong one on top.
//
// In an area: correlating all of it over all headings and heights is expensive; searching only the suggested places,
// and then the whole area for rivals of the result, is cheap.
#pragma once

#include <cstddef>
#include <optional>
#include <vector>

#include "base/progress.hpp"
#include "geodesy/local_frame.hpp"
#include "geodesy/lon_lat.hpp"
#include "geodesy/region.hpp"
#include "imagery/map_window.hpp"
#include "vision/oriented_channels.hpp"
#include "vision/rectification.hpp"

namespace nadir {

struct SearchPrior {
  CameraPose pose;               // attitude and height to begin with; the position is the middle of the window searched
  double radius_m = 100;         // half the side of the square of camera positions that are searched
  double heading_range_rad = 0;  // ± this around the pose's heading
  double scale_range = 0;        // ± this, relative, around the pose's height
};

struct SearchOptions {
  double gsd_m = kSearchGsd_m;                 // to search at
  double distinct_m = kDistinct_m;             // hypotheses closer than this are one place
  std::size_t candidates = kSearchCandidates;  // hypotheses that are confirmed
  double heading_step_rad = kHeadingStep_rad;
  double scale_step = kScaleStep;
  MatchFeatures features;
  Cancel cancel;  // checked before each heading and scale
};

// Offsets that cover ±range, each standing for half a step to both sides.
std::vector<double> offsets_within(double range, double step);

struct MatchHypothesis {
  CameraPose pose;
  double score = -1;         // of six channels
  double coarse_score = -1;  // of two channels in the sweep
};

struct SearchResult {
  std::vector<MatchHypothesis> places;  // best first; empty when nothing of the window could be matched
  double ratio = 1;  // second best / best; 1 when there is no second place to compare with or no match
};

// The frame is matched with `map`, a grey window that covers every searched footprint (missing parts are masked) and is
// not coarser than options.gsd_m.
SearchResult search_window(const cv::Mat& grey, const CameraModel& camera, const MapWindow& map,
                           const SearchPrior& prior, const SearchOptions& options);

// The result of several windows' hypotheses: the best one, distinct others, and the ratio over all of them.
SearchResult best_of(std::vector<MatchHypothesis> hypotheses, const SearchOptions& options);

// A frame, and the area of the map that it is searched in.
struct AreaQuery {
  const cv::Mat& grey;
  const CameraModel& camera;
  MapWindowReader& map;
  const LocalFrame& frame;
  SearchPrior prior;  // its position is not used
  SearchOptions options;
  double reach_m = 0;  // how far from the ground point under the camera a footprint may reach
};

struct AreaHypotheses {
  std::vector<MatchHypothesis> places;  // of all windows; best_of() sorts them
  bool on_map = false;                  // some window holds map
};

AreaHypotheses search_windows(const AreaQuery& query, const std::vector<SearchPrior>& windows);

// Place retrieval: finds places of a map that may look like a frame. Its results are suggestions; correlation and
// acceptance decide. The place index of a package is one (place_index.hpp).
struct PlaceQuery {
  // A frame as rectify() makes it, north-up under an assumed heading.
  cv::Mat grey;  // CV_8UC1
  cv::Mat mask;  // CV_8UC1, 255 where the frame shows the ground
  double gsd_m = 1;
  // The true heading lies within ± this of the assumed one, three sigma or more. Nothing: unknown; 24 are tried.
  std::optional<double> heading_range_rad;
  Cancel cancel{};
};

struct PlaceCandidate {
  std::size_t chunk = 0;                               // of the map, by the retrieval's numbers
  LonLat centre;                                       // of the chunk
  double side_m = 0;                                   // of the chunk, whose sides run north and east
  double score = -1;                                   // cosine, at most 1
  double turn_rad = 0;                                 // to be added to the assumed heading
  Eigen::Vector2d offset_m = Eigen::Vector2d::Zero();  // of the query's middle from the centre; good to side / 6
};

class PlaceRetrieval {
 public:
  virtual ~PlaceRetrieval() = default;
  // The `count` best chunks, best first; none when the image shows too little.
  virtual std::vector<PlaceCandidate> query(const PlaceQuery& query, std::size_t count) const = 0;
};

// Around the `count` places that look most like the frame to the retrieval.
AreaHypotheses search_retrieved(const AreaQuery& query, const PlaceRetrieval& retrieval, const PlaneBox& area,
                                std::size_t count);

// What else in the area looks like the frame under the heading and the height of `found`: the hypotheses with which it
// must be compared when only suggested windows were searched.
std::vector<MatchHypothesis> rivals(const AreaQuery& query, const PlaneBox& area, const MatchHypothesis& found);

}  // namespace nadir
