// A flight as it was flown, adjusted as a whole: tie points from its pictures, the looks at the map that were accepted,
// telemetry and what people said, in one block adjustment (adjustment/block_adjustment.hpp).
//
//   frame        starts at its smoothed pose
//   attitude     the telemetry's; its σ from camera.yaml, what is constant is boresight. Where none was
//                measured: as the filter has found that it scatters
//   height       the telemetry's, relative σ of camera.yaml, and a scale that all heights share
//   anchor       each accepted look, as the whole pose that the image alone determines, with the covariance that the
//                flight filter gives it (docs/localization.md)
//   fix          a pixel of a frame and its place on the map
//   tie points   tie_points.hpp
//   motion       smoothed steps between frames that odometry tracked and that few tie points join
//
// A segment that was placed on the map as a whole, and that nothing else ties to it, is held there by two of its
// frames. Where nothing ties a block of frames to the map, it is held where dead reckoning has its best-known frame,
// with the uncertainty that it has there: its shape is adjusted, its place is not, and its source is not an anchor.
// Where even that is unknown there are no positions.
//
// The map's own error is common to all anchors: no adjustment lessens it, and it is added to each covariance as the
// localizer adds it.
#pragma once

#include <cstddef>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <vector>

#include "adjustment/block_adjustment.hpp"
#include "base/progress.hpp"
#include "estimation/estimate.hpp"
#include "estimation/telemetry.hpp"
#include "flight_adjustment/tie_points.hpp"
#include "flights/flight_engine.hpp"
#include "geodesy/local_frame.hpp"

namespace nadir {

// A person's fix in a picture.
struct FixedPixel {
  std::size_t frame = 0;
  Eigen::Vector2d pixel = Eigen::Vector2d::Zero();  // of the camera
  PlanePoint place;
  double sigma_m = 0;
};

struct FlightToAdjust {
  CameraFile camera;                                             // of the images that image_of gives
  LocalFrame plane;                                              // of all positions
  const GroundSurface* ground = nullptr;                         // null: flat
  double no_fix_sigma_m = parameters::localizer::kNoFixSigma_m;  // beyond this no position is stated
  // One of each for every frame; `smoothed` is empty where no position is known at all.
  std::vector<Telemetry> telemetry{};
  std::vector<SmoothedFrame> smoothed{};
  std::vector<Estimate> refined{};
  std::vector<std::optional<FramePose>> refined_poses{};
  // Whether a frame belongs to a segment that was placed as a whole (segment_placement.hpp), where `refined` has it;
  // empty: none does.
  std::vector<bool> placed{};
  std::vector<FixedPixel> fixes{};
  FrameImageOf image_of{};
};

// Of the frames that the engine has processed. setup: the engine's. Both must outlive the result.
FlightToAdjust flight_to_adjust(const FlightStore& store, FlightEngine& engine, const FlightEngineSetup& setup);

struct AdjustmentSummary {
  AdjustmentOutcome outcome = AdjustmentOutcome::converged;
  std::size_t frames = 0, anchored_frames = 0, floating_frames = 0;  // floating: nothing ties them to the map
  std::size_t tie_points = 0, observations = 0, rejected_observations = 0, pairs_compared = 0, pairs_matched = 0;
  std::size_t anchors = 0, fixes = 0;
  std::vector<std::size_t> switched_off;                     // frames whose anchors the others contradict
  double mean_reprojection_px = 0, rms_reprojection_px = 0;  // in pictures of the size of calibration.camera
  CameraSelfCalibration calibration;
};
nlohmann::json json_from(const AdjustmentSummary& summary);

struct AdjustedFlight {
  std::vector<Estimate> estimates;              // of each frame
  std::vector<std::optional<FramePose>> poses;  // of frames whose own anchor was accepted and kept, as refined_poses()
  AdjustmentSummary summary;
  TiePoints ties;
  AdjustedBlock block;  // its points are those of `ties`, then those of fixes
};

// For the store: attitudes, heights and lens of the frames that have an adjusted position, with covariances that
// include the map's own error, as those of the estimates do. All frames share that error.
AdjustedPoses adjusted_poses(const AdjustedFlight& adjusted);

// For the store: that each frame that has an adjusted position has it.
std::vector<StoredFlightEvent> refinement_events(const AdjustedFlight& adjusted);

// Throws Interrupted, and what image_of throws. A flight without any known position comes back as it was.
AdjustedFlight adjust_flight(const FlightToAdjust& flight, Progress& progress, const Cancel& cancel = {});

}  // namespace nadir
