// The log of a flight and its fixed-interval smoother.
//
// FlightStep holds all inputs of the flight filter for one frame; apply_step() applies them again in the same order. So
// a late anchor can be inserted at its own frame, and the whole flight can be smoothed afterwards.
//
// Online, the belief accepts an anchor with what was known by then. Afterwards all anchors are tested against each
// other: with z, R an anchor's position and covariance, and x, P those of the smoothed track that it is part of, z - x
// has the covariance R - P. The anchor with the largest χ² above the limit is rejected, wholly, and the flight is
// smoothed again without it, until none is left (as with switchable constraints, Sünderhauf and Protzel 2012; a robust
// loss would still be pulled).
#pragma once

#include <optional>
#include <vector>

#include "estimation/estimate.hpp"
#include "estimation/flight_filter.hpp"

namespace nadir {

struct FlightStep {
  double seconds = 0;                        // since the last frame, intervals included
  std::vector<TelemetryInterval> intervals;  // Telemetry's
  std::optional<double> measured_heading_rad;
  bool tilt_measured = true;
  std::optional<Eigen::Vector2d> imu_dv_mps;
  std::vector<PreintegratedMotion> inertial;  // the whole way since the last frame; empty: not measured, or not whole
  std::optional<double> inertial_refused_sigma_m;  // images contradict the inertial sensor: refuse_inertial()
  std::optional<double> height_reset_sigma;        // of the log height: its source has changed
  std::optional<RelativeMotionMeasurement> relative_motion;
  // In place of relative_motion: since the frame before the last one, which is an outlier. The filter goes on from that
  // frame; the outlier's own step leads nowhere.
  std::optional<RelativeMotionMeasurement> motion_over_outlier;
  std::optional<double> contradicted_turn_rad;        // the images' turn beyond the telemetry's: inflates the heading
  std::optional<double> wrong_course_sigma_m;         // inflates the position: the course may be another one
  std::optional<double> hint_sigma_m;                 // the same, before the frame was matched: an operator's hint
  std::optional<double> contradicted_anchor_sigma_m;  // the same, before the anchor: it contradicts the track
  // The same, before the anchor: it was matched with a finer map than the anchors before it, so that their
  // positions have the error of a coarser map.
  std::optional<double> finer_map_sigma_m;
  std::optional<PoseMeasurement> anchor;
  double map_sigma_m = 0;  // with an anchor: of the tiles that it was matched with, one axis; for what is published
  bool anchor_unambiguous = false;  // clearer than any wrong place ever was: needs no corroboration by another anchor
  TelemetryReference reference;     // for poses alone
  Eigen::Vector3d rate_rad_s = Eigen::Vector3d::Zero();  // likewise, CameraMotion's
};

// At the step's frame, whose state that is.
CameraMotion camera_motion(const FlightFilter::State& state, const FlightStep& step);

// Brings the filter to the step's frame, through its intervals.
void propagate_to(FlightFilter& filter, const FlightStep& step);

// Applies a step to the filter, with its anchor or without. Returns the correction of the previous frame's position
// (FlightFilter::update_relative()).
Eigen::Vector2d apply_step(FlightFilter& filter, const FlightStep& step, bool with_anchor);

// Brings the filter, which is at the frame before the outlier, to the step's frame.
void propagate_over(FlightFilter& filter, const FlightStep& outlier, const FlightStep& step);

// apply_step() of a step with motion_over_outlier. filter: as it was before the outlier's step.
Eigen::Vector2d apply_step_over(FlightFilter& filter, const FlightStep& outlier, const FlightStep& step,
                                bool with_anchor);

struct SmoothedFlight {
  std::vector<FlightFilter::Smoothed> frames;
  std::vector<std::size_t> rejected_anchors;  // frames whose anchors the others contradict, in the order of rejection
};

// initial: the filter before the first step.
SmoothedFlight smooth_flight(const FlightFilter& initial, const std::vector<FlightStep>& steps);

}  // namespace nadir
