// The camera's pose from what of a rectified frame was found on the map, whoever found it. Solving and rectifying anew
// with the pose solved take turns.
#pragma once

#include <optional>

#include "vision/anchor_matcher.hpp"
#include "vision/patch_match.hpp"

namespace nadir {

class PoseRefinement {
 public:
  // begin: the pose that the search came to. The map's pixels are the unit of what agrees. All but `begin` must outlive
  // this.
  PoseRefinement(const CameraModel& camera, const AnchorPrior& prior, const CameraPose& begin, const MapWindow& map,
                 const GroundSurface& surface);

  const CameraPose& pose() const { return pose_; }  // the best so far
  // A grid over the pose's footprint, aligned with the map's pixels.
  std::optional<GroundGrid> grid() const;

  // found: of `rectified`, which was made with `rectified_with`. Fills the match; false when no pose could be solved.
  // inlier_px: what agrees. found_px: the side of what was found, as far as it counts for the share of the frame.
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
