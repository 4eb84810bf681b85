// The flight log as one batch for Ceres: a pose graph with the same sensor models as the flight filter, solved
// again from its current state after every step, with Geman and McClure's loss on anchors instead of switching them
// off.
#pragma once

#include "estimation/drawn_flight.hpp"

namespace nadir::bench {

struct BatchGraph {
  std::vector<FlightFilter::Smoothed> frames;
  double solve_s = 0, covariance_s = 0;  // CPU time
};

// Starts from the filter's online estimates.
BatchGraph solve_batch(const test::DrawnFlight& flight, const TelemetryUncertainty& uncertainty, bool covariances);

}  // namespace nadir::bench
