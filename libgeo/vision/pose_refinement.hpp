// The camera's pose from the parts of a rectified frame that were found on the map, by any matcher. Solving alternates
// with rectifying again with the solved pose.
#pragma once

#include <optional>

#include "vision/map_matcher.hpp"
#include "vision/patch_matching.hpp"

namespace nadir {

class PoseRefinement {
 public:
  // begin: the pose that the search found. Inliers are counted in the map's pixels. All but `begin` must outlive this.
  PoseRefinement(const CameraModel& camera, const AnchorPrior& prior, const CameraPose& begin, const MapWindow& map,
                 const GroundSurface& surface);

  const CameraPose& pose() const { return pose_; }  // the best so far
  // A grid over the pose's footprint, aligned with the map's pixels.
  std::optional<GroundGrid> grid() const;

  // found: in `rectified`, which was made with `rectified_with`. Fills the match; false when no pose could be solved.
  // inlier_px: residual up to which a match agrees. found_px: side of the ground that each match covers, for the share
  // of the frame that they span.
  bool solve(AnchorMatch& match, const PatchMatches& found, const RectifiedFrame& rectified,
             const CameraPose& rectified_with, double inlier_px, double found_px);

 private:
  const CameraModel& camera_;
  const MapWindow& map_;
  const GroundSurface& surface_;
  PosePrior prior_;
  CameraPose pose_;
  double scatter_m_ = 0;
};

}  // namespace nadir
