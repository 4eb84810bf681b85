// One anchor attempt: search the window, refine with patches, solve the camera's pose. Says what it found and how well;
// whether to believe it is decided by the gates (estimation/anchor_gates.hpp).
#pragma once

#include <Eigen/Core>
#include <optional>

#include "geodesy/local_frame.hpp"
#include "geodesy/region.hpp"
#include "imagery/tile_source.hpp"
#include "vision/camera_pose_solver.hpp"
#include "vision/place_search.hpp"

namespace nadir {

struct AnchorPrior {
  SearchPrior search;
  double heading_sigma_rad = 0.05;
  double log_agl_sigma = 0.05;
  Eigen::Matrix2d tilt_covariance_rad2 = Eigen::Matrix2d::Identity() * 0.003;
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

AnchorMatch match_anchor(const cv::Mat& grey, const CameraModel& camera, const TileSource& tiles,
                         const LocalFrame& frame, const AnchorPrior& prior, const GroundSurface& surface = FlatGround(),
                         const Likeness& likeness = {});

// The same when nothing is known of the position: all of `area` (camera positions, in the map's plane) is searched, and
// the ratio compares the best place with the best one anywhere else in it. The position in `prior` is not used.
AnchorMatch match_anchor_anywhere(const cv::Mat& grey, const CameraModel& camera, const TileSource& tiles,
                                  const LocalFrame& frame, const AnchorPrior& prior, const PlaneBox& area,
                                  const GroundSurface& surface = FlatGround(), const Likeness& likeness = {});

// The ground sample distances to match at: fine enough for a template of some 400 pixels, never much finer than frame
// or map.
struct MatchingScale {
  double fine_gsd_m = 0.5;
  double coarse_gsd_m = 1.0;
};
MatchingScale matching_scale(const CameraModel& camera, double agl_m, double map_gsd_m);

}  // namespace nadir
