#include "estimation/flight_log.hpp"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>

namespace nadir {
namespace {

constexpr double kContradiction = 25;      // chi-square, two degrees of freedom: one in 270 000, of many anchors
constexpr std::size_t kMostSwitched = 40;  // passes over the flight

std::vector<FlightFilter::Smoothed> smoothed_without(const FlightFilter& fresh, const std::vector<FlightStep>& steps,
                                                     const std::vector<bool>& off) {
  FlightFilter filter = fresh;
  filter.remember();
  for (std::size_t i = 0; i < steps.size(); ++i) take_step(filter, steps[i], !off[i]);
  return filter.smoothed();
}

// What an anchor lies off the track that it has helped to make. Its own part in it makes both the distance and what it
// may be smaller: covariance of the anchor minus that of the track.
double contradiction(const PoseMeasurement& anchor, const FlightFilter::Smoothed& frame) {
  const Eigen::Vector2d off = anchor.seen.head<2>() - frame.position_m;
  const Eigen::Matrix2d own = anchor.covariance.topLeftCorner<2, 2>();
  // An anchor alone in a wide gap makes the track: nothing is left to contradict it.
  const Eigen::Matrix2d spread = own - frame.covariance_m2 + 0.02 * own.trace() * Eigen::Matrix2d::Identity();
  if (!(spread.determinant() > 0) || !(spread(0, 0) > 0)) return 0;
  return off.dot(spread.inverse() * off);
}

}  // namespace

void carry_to(FlightFilter& filter, const FlightStep& step) {
  double left_s = step.seconds;
  for (const TelemetryInterval& stretch : step.way) {
    filter.carry(stretch);
    left_s -= stretch.seconds;
  }
  filter.advance(left_s, step.measured_heading_rad, step.tilt_measured, step.imu_dv_mps);
}

Eigen::Vector2d take_step(FlightFilter& filter, const FlightStep& step, bool with_anchor) {
  Eigen::Vector2d taught_m = Eigen::Vector2d::Zero();
  carry_to(filter, step);
  if (step.height_doubt) filter.doubt_height(*step.height_doubt);
  if (step.moved) taught_m = filter.moved(*step.moved);
  if (step.contradicted_turn_rad) filter.doubt_heading(*step.contradicted_turn_rad);
  if (step.way_doubt_m) filter.doubt_position(*step.way_doubt_m);
  if (step.hint_doubt_m) filter.doubt_position(*step.hint_doubt_m);
  if (step.position_doubt_m) filter.doubt_position(*step.position_doubt_m);
  if (step.anchored && with_anchor) filter.anchored(*step.anchored);
  return taught_m;
}

SmoothedFlight smooth_flight(const FlightFilter& fresh, const std::vector<FlightStep>& steps) {
  SmoothedFlight flight;
  std::vector<bool> off(steps.size(), false);
  while (true) {
    flight.frames = smoothed_without(fresh, steps, off);
    std::size_t worst = 0;
    double most = kContradiction;
    for (std::size_t i = 0; i < steps.size(); ++i) {
      if (!steps[i].anchored || off[i]) continue;
      const double here = contradiction(*steps[i].anchored, flight.frames[i]);
      if (here <= most) continue;
      most = here;
      worst = i;
    }
    if (most <= kContradiction || flight.switched_off.size() == kMostSwitched) return flight;
    off[worst] = true;
    flight.switched_off.push_back(worst);
  }
}

}  // namespace nadir
