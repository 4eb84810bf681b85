// One anchor attempt: search the window, refine with patches, solve the camera's pose. Says what it found and how well;
// whether to believe it is decided by the gates (estimation/anchor_gates.hpp).
#pragma once

#include <Eigen/Core>
#include <optional>

#include "geodesy/local_frame.hpp"
#include "geodesy/region.hpp"
#include "imagery/map_window.hpp"
#include "vision/camera_pose_solver.hpp"
#include "vision/place_memory.hpp"
#include "vision/place_search.hpp"

namespace nadir {

struct AnchorPrior {
  SearchPrior search;
  double heading_sigma_rad = 0.05;
  double log_agl_sigma = 0.05;
  Eigen::Matrix2d tilt_covariance_rad2 = Eigen::Matrix2d::Identity() * 0.003;
  Cancel cancel;  // nothing that is believed: ends the attempt by Interrupted, for a search may last half a minute
};

struct AnchorMatch {
  SearchResult search;
  std::optional<SolvedPose> solved;
  int patches = 0;         // tried in the last round
  double frame_share = 0;  // share of the frame's footprint that the agreeing patches span
  double fine_gsd_m = 0;
  double coarse_gsd_m = 0;
  bool on_map = true;  // false: the window holds no map
  cv::Mat rectified;   // grey, as matched in the last round
  cv::Mat matched_map;
};

// map: keeps the tiles that it decoded, so that attempts over the same ground are cheap; what it keeps changes nothing.
AnchorMatch match_anchor(const cv::Mat& grey, const CameraModel& camera, MapWindowReader& map, const LocalFrame& frame,
                         const AnchorPrior& prior, const GroundSurface& surface = FlatGround(),
                         const Likeness& likeness = {});

// The same when nothing is known of the position: all of `area` (camera positions, in the map's plane) is searched, and
// the ratio compares the best place with the best one anywhere else in it. The position in `prior` is not used.
AnchorMatch match_anchor_anywhere(const cv::Mat& grey, const CameraModel& camera, MapWindowReader& map,
                                  const LocalFrame& frame, const AnchorPrior& prior, const PlaneBox& area,
                                  const GroundSurface& surface = FlatGround(), const Likeness& likeness = {});

// Where to look first, without a word on whether it is true.
struct PlaceSuggestions {
  std::optional<PlaneBox> hint;         // camera positions that somebody names
  const PlaceRetrieval* memory = nullptr;  // names places that look alike
};

// As match_anchor_anywhere(), but looks only where it is suggested. What is found there is compared with the whole
// area, under its own heading and height: the ratio means the same, and suggestions cannot make a place look unique.
AnchorMatch match_anchor_among(const cv::Mat& grey, const CameraModel& camera, MapWindowReader& map,
                               const LocalFrame& frame, const AnchorPrior& prior, const PlaneBox& area,
                               const PlaceSuggestions& suggested, const GroundSurface& surface = FlatGround(),
                               const Likeness& likeness = {});

// The ground sample distances to match at: fine enough for a template of some 400 pixels, never much finer than frame
// or map.
struct MatchingScale {
  double fine_gsd_m = 0.5;
  double coarse_gsd_m = 1.0;
};
MatchingScale matching_scale(const CameraModel& camera, double agl_m, double map_gsd_m);

}  // namespace nadir
