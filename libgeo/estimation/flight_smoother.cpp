#include "estimation/flight_smoother.hpp"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>

#include "vision/localizer_parameters.hpp"

namespace nadir {
namespace {

using namespace parameters::smoother;

std::vector<FlightFilter::Smoothed> smooth_without(const FlightFilter& initial, const std::vector<FlightStep>& steps,
                                                   const std::vector<bool>& off) {
  FlightFilter filter = initial;
  filter.keep_history();
  for (std::size_t i = 0; i < steps.size(); ++i) apply_step(filter, steps[i], !off[i]);
  return filter.smoothed();
}

// χ² of an anchor against the track that it is part of. Its own share makes both the distance and its covariance
// smaller: covariance of the anchor minus that of the track.
double contradiction_chi2(const PoseMeasurement& anchor, const FlightFilter::Smoothed& frame) {
  const Eigen::Vector2d off = anchor.value.head<2>() - frame.position.vector();
  const Eigen::Matrix2d own = anchor.covariance.topLeftCorner<2, 2>();
  // A single anchor in a wide gap makes the track: nothing is left to contradict it.
  const Eigen::Matrix2d spread =
      own - frame.covariance_m2 + kSoleAnchorShare * own.trace() * Eigen::Matrix2d::Identity();
  if (!(spread.determinant() > 0) || !(spread(0, 0) > 0)) return 0;
  return off.dot(spread.inverse() * off);
}

}  // namespace

void propagate_to(FlightFilter& filter, const FlightStep& step) {
  double left_s = step.seconds;
  for (const TelemetryInterval& interval : step.intervals) {
    filter.propagate(interval);
    left_s -= interval.seconds;
  }
  filter.predict(left_s, step.measured_heading_rad, step.tilt_measured, step.imu_dv_mps);
}

Eigen::Vector2d apply_step(FlightFilter& filter, const FlightStep& step, bool with_anchor) {
  Eigen::Vector2d past_correction_m = Eigen::Vector2d::Zero();
  propagate_to(filter, step);
  if (step.height_reset_sigma) filter.reset_height(*step.height_reset_sigma);
  if (step.relative_motion) past_correction_m = filter.update_relative(*step.relative_motion);
  if (step.contradicted_turn_rad) filter.inflate_heading(*step.contradicted_turn_rad);
  if (step.wrong_course_sigma_m) filter.inflate_position(*step.wrong_course_sigma_m);
  if (step.hint_sigma_m) filter.inflate_position(*step.hint_sigma_m);
  if (step.contradicted_anchor_sigma_m) filter.inflate_position(*step.contradicted_anchor_sigma_m);
  if (step.finer_map_sigma_m) filter.inflate_position(*step.finer_map_sigma_m);
  if (step.anchor && with_anchor) filter.update_absolute(*step.anchor);
  return past_correction_m;
}

SmoothedFlight smooth_flight(const FlightFilter& initial, const std::vector<FlightStep>& steps) {
  SmoothedFlight flight;
  std::vector<bool> off(steps.size(), false);
  while (true) {
    flight.frames = smooth_without(initial, steps, off);
    std::size_t worst = 0;
    double largest = kContradiction_chi2;
    for (std::size_t i = 0; i < steps.size(); ++i) {
      if (!steps[i].anchor || off[i]) continue;
      const double chi2 = contradiction_chi2(*steps[i].anchor, flight.frames[i]);
      if (chi2 <= largest) continue;
      largest = chi2;
      worst = i;
    }
    if (largest <= kContradiction_chi2 || flight.rejected_anchors.size() == kMaxRejectedAnchors) return flight;
    off[worst] = true;
    flight.rejected_anchors.push_back(worst);
  }
}

}  // namespace nadir
