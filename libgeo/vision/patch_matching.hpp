// Fine matching: small patches of a rectified frame against the map around their predicted positions.
//
// Each patch measures by how much its content lies elsewhere on the map than the pose predicts. Patches on bare ground
// measure nothing and are left out; one on a single straight edge is precise across and vague along it. Its covariance
// is that of the score's peak, with H the negated Hessian of the score, n the noise of scores and f a floor:
//   Σ_px = (H / n + ε I)⁻¹ + f² I
#pragma once

#include <Eigen/Core>
#include <vector>

#include "imagery/map_window.hpp"
#include "vision/correlation.hpp"
#include "vision/oriented_channels.hpp"
#include "vision/rectification.hpp"

namespace nadir {

struct PatchOptions {
  int patch_px = kPatch_px;
  int columns = kPatchColumns;  // of patches over the camera's image
  int rows = kPatchRows;
  double search_px = kPatchSearch_px;  // a patch may lie this far off
  double min_score = kMinPatchScore;   // correlation below this is no match
  MatchFeatures features;              // its fine channels
};

struct PatchMatch {
  PlanePoint in_frame;  // the patch's centre, where the rectified frame put it
  PlanePoint on_map;    // where the map has the same content
  double score = 0;
  Eigen::Matrix2d information_m2 = Eigen::Matrix2d::Zero();  // inverse covariance of on_map, 1/m²
};

struct PatchMatches {
  std::vector<PatchMatch> found;
  int tried = 0;  // patches that lie wholly on the frame
};

// Σ⁻¹ of the peak of a patch's scores (CV_32FC1, a pixel of side gsd_m for each placement), in 1/m². Not finite where
// the scores have no peak.
Eigen::Matrix2d peak_information_m2(const cv::Mat& scores, const Peak& peak, double gsd_m);

// The grids of `frame` and `map` must be aligned: same GSD, whole pixels apart. The patches' centres stand on a grid in
// the camera's image, so that they fill it whatever the heading. map_channels: the fine ones of `map`, for callers that
// match the same ground repeatedly.
PatchMatches match_patches(const RectifiedFrame& frame, const CameraModel& camera, const CameraPose& pose,
                           const MapWindow& map, MapChannels& map_channels, const PatchOptions& options,
                           const GroundSurface& surface = FlatGround());
PatchMatches match_patches(const RectifiedFrame& frame, const CameraModel& camera, const CameraPose& pose,
                           const MapWindow& map, const PatchOptions& options,
                           const GroundSurface& surface = FlatGround());

}  // namespace nadir
