#include "estimation/flight_smoother.hpp"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>

#include "vision/localizer_parameters.hpp"

namespace nadir {
namespace {

using namespace parameters::smoother;

// A frame that the track skips. Nothing after it says where it was taken: its position is dead-reckoned from the frame
// before it, with that frame's correction.
struct Outlier {
  std::size_t step = 0;
  FlightFilter::Smoothed before, predicted;
};

FlightFilter::Smoothed state_of(const FlightFilter& filter) {
  return {filter.position(), filter.position_covariance_m2(), filter.state()};
}

std::vector<FlightFilter::Smoothed> smooth_without(const FlightFilter& initial, const std::vector<FlightStep>& steps,
                                                   const std::vector<bool>& off) {
  FlightFilter filter = initial;
  filter.keep_history();
  std::vector<Outlier> outliers;
  for (std::size_t i = 0; i < steps.size(); ++i) {
    if (i + 1 < steps.size() && steps[i + 1].motion_over_outlier) {
      const FlightFilter before = filter;
      apply_step(filter, steps[i], !off[i]);
      outliers.push_back({i, state_of(before), state_of(filter)});
      filter = before;
      ++i;
      apply_step_over(filter, steps[i - 1], steps[i], !off[i]);
    } else {
      apply_step(filter, steps[i], !off[i]);
    }
  }
  std::vector<FlightFilter::Smoothed> frames = filter.smoothed();
  for (const Outlier& outlier : outliers) {
    FlightFilter::Smoothed frame = outlier.predicted;
    if (outlier.step > 0) {
      const Eigen::Vector2d correction_m = frames[outlier.step - 1].position - outlier.before.position;
      frame.position = frame.position + correction_m;
      frame.state.head<2>() += correction_m;
    }
    frames.insert(frames.begin() + static_cast<std::ptrdiff_t>(outlier.step), frame);
  }
  return frames;
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

CameraMotion camera_motion(const FlightFilter::State& state, const FlightStep& step) {
  return {state.segment<2>(FlightFilter::velocity_east), step.rate_rad_s};
}

void propagate_to(FlightFilter& filter, const FlightStep& step) {
  const auto& inertial = step.inertial;
  if (filter.inertial() && !inertial.empty()) {
    for (std::size_t i = 0; i + 1 < inertial.size(); ++i) filter.propagate(inertial[i]);
    filter.predict(inertial.back(), step.measured_heading_rad,
                   step.tilt_measured ? std::optional(step.reference.tilt_rad) : std::nullopt);
    return;
  }
  double left_s = step.seconds;
  for (const TelemetryInterval& interval : step.intervals) {
    filter.propagate(interval);
    left_s -= interval.seconds;
  }
  filter.predict(left_s, step.measured_heading_rad, step.tilt_measured, step.imu_dv_mps);
  if (!inertial.empty() && step.tilt_measured && step.measured_heading_rad) {
    filter.begin_inertial(step.reference.tilt_rad);
  }
}

void propagate_over(FlightFilter& filter, const FlightStep& outlier, const FlightStep& step) {
  if (filter.inertial() && !outlier.inertial.empty()) {
    for (const PreintegratedMotion& motion : outlier.inertial) filter.propagate(motion);
    propagate_to(filter, step);
    return;
  }
  double left_s = outlier.seconds;
  for (const TelemetryInterval& interval : outlier.intervals) {
    filter.propagate(interval);
    left_s -= interval.seconds;
  }
  filter.propagate({left_s, outlier.measured_heading_rad, outlier.imu_dv_mps});
  propagate_to(filter, step);
}

namespace {

// All of a step but the propagation.
Eigen::Vector2d update_with(FlightFilter& filter, const FlightStep& step,
                            const std::optional<RelativeMotionMeasurement>& motion, bool with_anchor) {
  Eigen::Vector2d past_correction_m = Eigen::Vector2d::Zero();
  if (step.height_reset_sigma) filter.reset_height(*step.height_reset_sigma);
  if (step.inertial_refused_sigma_m) filter.refuse_inertial(*step.inertial_refused_sigma_m);
  if (motion) past_correction_m = filter.update_relative(*motion);
  if (step.contradicted_turn_rad) filter.inflate_heading(*step.contradicted_turn_rad);
  if (step.wrong_course_sigma_m) filter.inflate_position(*step.wrong_course_sigma_m);
  if (step.hint_sigma_m) filter.inflate_position(*step.hint_sigma_m);
  if (step.contradicted_anchor_sigma_m) filter.inflate_position(*step.contradicted_anchor_sigma_m);
  if (step.finer_map_sigma_m) filter.inflate_position(*step.finer_map_sigma_m);
  if (step.anchor && with_anchor) filter.update_absolute(*step.anchor);
  return past_correction_m;
}

}  // namespace

Eigen::Vector2d apply_step(FlightFilter& filter, const FlightStep& step, bool with_anchor) {
  propagate_to(filter, step);
  return update_with(filter, step, step.relative_motion, with_anchor);
}

Eigen::Vector2d apply_step_over(FlightFilter& filter, const FlightStep& outlier, const FlightStep& step,
                                bool with_anchor) {
  propagate_over(filter, outlier, step);
  return update_with(filter, step, step.motion_over_outlier, with_anchor);
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
