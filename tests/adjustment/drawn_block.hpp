// A survey drawn at random: strips flown over rolling ground, with honest noise on every measurement, for tests and
// benches of block adjustment. No image is made: points are projected.
#pragma once

#include <vector>

#include "adjustment/block_adjustment.hpp"
#include "base/random.hpp"

namespace nadir::test {

class RollingGround final : public GroundSurface {
 public:
  explicit RollingGround(double amplitude_m = 15) : amplitude_m_(amplitude_m) {}
  double height_m(PlanePoint point) const override;
  double relief_sigma_m() const override { return 3; }

 private:
  double amplitude_m_;
};

struct DrawnBlockOptions {
  int strips = 2, frames_per_strip = 5;
  double forward_m = 40, side_m = 90, agl_m = 150;
  int points_per_frame = 40;  // observations of a frame, about
  int longest_track = 8;      // observations of a point, at most
  double observation_sigma_px = 0.5;
  double tilt_sigma_rad = 0.01, heading_sigma_rad = 0.02;  // of what differs from frame to frame
  double height_sigma = 0.02;                              // likewise, relative
  double anchor_sigma_m = 4;
  int anchor_every = 3;           // frames; 0: none
  double wrong_anchor_share = 0;  // 150 to 600 m off
  double wrong_observation_share = 0;
  double drift_share = 0.1;    // of each step of the start
  double start_offset_m = 15;  // of the start as a whole, 1-sigma
  double terrain_sigma_m = 3;  // of the terrain model, the same in each cell of its correlation length
  double relief_sigma_m = 1;   // of points beyond that: bushes, ditches
  CalibrationPrior calibration{
      .focal_relative = 0.01, .radial = 0.02, .tangential = 0.001, .boresight_rad = 0.01, .height_scale = 0.01};
};

struct DrawnBlock {
  CameraModel nominal;  // what the adjustment is given
  CameraModel camera;   // the true one
  Eigen::Vector3d boresight_rad;
  double log_height_scale = 0;
  std::vector<AdjustmentFrame> frames;
  std::vector<CameraPose> poses;           // true
  std::vector<Eigen::Vector3d> centres_m;  // true
  std::vector<PositionAnchor> anchors;
  std::vector<bool> wrong;  // per anchor
  std::vector<TiePoint> points;
  std::vector<Eigen::Vector3d> points_m;  // true

  AdjustmentOptions options(const DrawnBlockOptions& drawn) const;
  void add_to(BlockAdjustment& adjustment) const;
};

DrawnBlock draw_block(Random random, const DrawnBlockOptions& options, const GroundSurface& ground);

// Mean normalised squared errors of the anchored frames with covariances: of position in the plane (2 degrees of
// freedom), and in space (3). How far off, 2-D.
struct BlockErrors {
  double nees_2d = 0, nees_3d = 0, rms_m = 0, largest_m = 0;
  std::size_t frames = 0;
};
BlockErrors block_errors(const AdjustedBlock& adjusted, const DrawnBlock& truth);

}  // namespace nadir::test
