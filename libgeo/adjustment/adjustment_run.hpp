// One block adjustment: its data, what it changes, and the run that changes it. block_adjustment.hpp explains the
// method.
#pragma once

#include "adjustment/block_adjustment.hpp"
#include "adjustment/residuals.hpp"

namespace nadir {

// Everything that an adjustment changes, so that a cancelled one changes nothing.
struct BlockState {
  std::vector<FrameBlock> frames;
  std::vector<Eigen::Vector3d> points;
  std::vector<bool> point_known;
  CalibrationBlock calibration;
  std::vector<FrameState> frame_states;                    // as last adjusted; floating before
  std::vector<std::optional<PoseCovariance>> covariances;  // likewise
  CameraSelfCalibration reported;                          // likewise
};

// Of either kind.
struct BlockAnchor {
  std::size_t frame = 0;
  PlanePoint position;
  Eigen::Matrix2d covariance_m2;  // without a pose
  std::optional<PoseAnchor> whole;
};

// The data of a block, as added.
struct BlockData {
  CameraModel camera;
  const GroundSurface& ground;
  AdjustmentOptions options;
  AdjustableLens lens;
  std::vector<AdjustmentFrame> frames;
  std::vector<FrameBlock> starts;  // of the frames
  std::vector<BlockAnchor> anchors;
  std::vector<TiePoint> points;
};

// Adjusts the frames of the window and what depends on them. Throws Interrupted; `state` is then worth nothing.
AdjustedBlock run_adjustment(const BlockData& data, BlockState& state, FrameWindow window, Progress& progress,
                             const Cancel& cancel);

}  // namespace nadir
