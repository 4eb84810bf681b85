// What the flight filter was told, frame by frame, so that the whole flight can be thought over once it is known.
//
// Online, an anchor that passed the gates is believed. Afterwards all others are witnesses: an anchor that contradicts
// them is switched off, wholly, and the flight is smoothed without it (as switchable constraints do, Sunderhauf and
// Protzel 2012; a robust loss would still pull).
#pragma once

#include <optional>
#include <vector>

#include "estimation/flight_filter.hpp"

namespace nadir {

struct FlightStep {
  double seconds = 0;            // since the last frame, the way included
  std::vector<TelemetryInterval> way;  // Telemetry's
  std::optional<double> measured_heading_rad;
  bool tilt_measured = true;
  std::optional<Eigen::Vector2d> imu_dv_mps;
  std::optional<double> height_doubt;  // log sigma
  std::optional<RelativeMotionMeasurement> moved;
  std::optional<double> contradicted_turn_rad;  // what the pictures turned beyond the telemetry
  std::optional<double> way_doubt_m;            // the aircraft may have flown another way
  std::optional<double> hint_doubt_m;           // before the frame was looked up
  std::optional<double> position_doubt_m;       // before the anchor
  std::optional<PoseMeasurement> anchored;
  bool anchored_clearly = false;  // such that no wrong place ever was: it needs no second one beside it
  double measured_agl_m = 0;          // what the filter's height and tilt are beyond: for poses alone
  Eigen::Vector2d measured_tilt_rad = Eigen::Vector2d::Zero();
};

// Brings the filter to the step's frame, along its way.
void carry_to(FlightFilter& filter, const FlightStep& step);

// Takes a step with the filter as it was taken in flight, with its anchor or without. Returns what it taught of the
// frame before (FlightFilter::moved).
Eigen::Vector2d take_step(FlightFilter& filter, const FlightStep& step, bool with_anchor);

struct SmoothedFlight {
  std::vector<FlightFilter::Smoothed> frames;
  std::vector<std::size_t> switched_off;  // frames whose anchors the others contradict, in the order they were found
};

// fresh: the filter before the first step.
SmoothedFlight smooth_flight(const FlightFilter& fresh, const std::vector<FlightStep>& steps);

}  // namespace nadir
