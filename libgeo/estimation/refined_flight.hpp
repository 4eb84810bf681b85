// A flight after its last frame: what was published frame by frame, again with all that was measured later.
//
// The log is smoothed (flight_smoother.hpp): anchors that the others contradict are rejected, and between two anchors a
// frame knows both.
#pragma once

#include <Eigen/Core>
#include <functional>
#include <optional>
#include <vector>

#include "estimation/estimate.hpp"
#include "estimation/flight_smoother.hpp"
#include "geodesy/local_frame.hpp"

namespace nadir {

struct FlownFlight {
  const FlightFilter& initial;  // before the first frame
  const std::vector<FlightStep>& steps;
  const LocalFrame& frame;
  double no_fix_sigma_m = 0;  // beyond this no position is published
  bool anchored = false;      // to a map at all
  // What no number of anchors averages out, of a map with this sigma [m].
  std::function<Eigen::Matrix2d(double map_sigma_m)> shared_error_m2;
};

// online: an estimate for each step. Their positions, covariances and sources are replaced; of a protection level,
// which is that of the belief in flight, nothing is left.
std::vector<Estimate> refined_estimates(std::vector<Estimate> online, const FlownFlight& flight);

// For each step, if its own anchor was accepted and contradicts no other.
std::vector<std::optional<FramePose>> refined_poses(const FlownFlight& flight);

// last: the filter after the last step, for what it has learned of the telemetry.
std::vector<SmoothedFrame> smoothed_frames(const FlownFlight& flight, const FlightFilter& last);

}  // namespace nadir
