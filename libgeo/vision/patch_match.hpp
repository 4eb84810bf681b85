// Fine matching: small patches of a rectified frame against the same piece of the map.
//
// Each patch says by how much its content lies elsewhere on the map than the pose claims. Patches on bare ground say
// nothing and are left out; one on a single straight border is sharp across and vague along it, which its information
// matrix carries.
#pragma once

#include <Eigen/Core>
#include <vector>

#include "imagery/map_window.hpp"
#include "vision/map_channels.hpp"
#include "vision/oriented_channels.hpp"
#include "vision/rectify.hpp"

namespace nadir {

struct PatchOptions {
  int patch_px = 48;
  int columns = 12;  // of patches over the camera's picture
  int rows = 8;
  double search_px = 10;   // a patch may lie this far off
  double min_score = 0.2;  // correlation below this is no match
  Likeness likeness;       // its fine channels
};

struct PatchMatch {
  PlanePoint in_frame;  // the patch's centre, where the rectified frame put it
  PlanePoint on_map;    // where the map has the same content
  double score = 0;
  Eigen::Matrix2d information_m2 = Eigen::Matrix2d::Zero();  // inverse covariance of on_map, 1/m²
};

struct PatchMatches {
  std::vector<PatchMatch> found;
  int tried = 0;  // patches that lie on the frame wholly
};

// The grids of `frame` and `map` must be aligned: same GSD, whole pixels apart. The patches' centres stand on a grid in
// the camera's picture, so that they fill it however it is turned. map_channels: of `map`, the fine ones; for whoever
// matches with the same ground again.
PatchMatches match_patches(const RectifiedFrame& frame, const CameraModel& camera, const CameraPose& pose,
                           const MapWindow& map, MapChannels& map_channels, const PatchOptions& options,
                           const GroundSurface& surface = FlatGround());
PatchMatches match_patches(const RectifiedFrame& frame, const CameraModel& camera, const CameraPose& pose,
                           const MapWindow& map, const PatchOptions& options,
                           const GroundSurface& surface = FlatGround());

}  // namespace nadir
