#include "estimation/tracking_state.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "vision/localizer_parameters.hpp"

namespace nadir {
namespace {

using namespace parameters::tracking;

double max_speed_mps(const FlightFilter& flight, double sigmas, double least_sigma_mps) {
  const auto& covariance = flight.covariance();
  const double sigma_mps =
      std::sqrt(0.5 * covariance.block<2, 2>(FlightFilter::velocity_east, FlightFilter::velocity_east).trace());
  const double speed_mps = flight.state().segment<2>(FlightFilter::velocity_east).norm();
  return speed_mps + sigmas * std::max(sigma_mps, least_sigma_mps);
}

}  // namespace

bool TrackingState::expects_overlap(const FlightFilter& flight, double seconds, double footprint_m) const {
  return linked_ &&
         max_speed_mps(flight, kOverlapSpeedSigmas, 0) * std::abs(seconds) < kOverlapReachShare * footprint_m;
}

void TrackingState::on_frame(const FrameLink& link) {
  const bool tracked = link.tracked || link.over_outlier;
  if (link.over_outlier) {
    unbroken_ = unbroken_before_;
    segment_ = segment_before_;
  } else if (!tracked && !link.first) {
    unbroken_before_ = unbroken_;
    segment_before_ = segment_;
    unbroken_ = false;
    segment_ = ++highest_segment_;
  }
  broken_ = link.comparable && link.expected_overlap && !tracked;
  linked_ = link.comparable && (tracked || link.first);
  tracked_ = tracked;
}

bool exceeds_reach(const FlightFilter& flight, double step_m, double seconds, double footprint_m) {
  if (seconds == 0) return false;
  return step_m >
         max_speed_mps(flight, kLeapSpeedSigmas, kGusts_mps) * std::abs(seconds) + kLeapSlackShare * footprint_m;
}

bool contradicts_turn(double turn_rad, double heading_sigma_rad) {
  return std::abs(turn_rad) > std::max(kContradictedTurn_rad, kContradictedTurnSigmas * heading_sigma_rad);
}

bool is_chance_motion(const FlightFilter& flight, const RelativeMotionMeasurement& measurement, int inliers) {
  return inliers < kSureInliers && flight.motion_chi2(measurement) > kChanceMotion_chi2;
}

double motion_doubt(const FlightFilter::MotionFit& fit, int inliers, double frame_m2) {
  if (inliers >= kSureInliers) return 0;
  const double chance = kChanceShare / (frame_m2 * 2 * kContradictedTurn_rad);
  const double right = (1 - kChanceShare) * std::exp(-fit.chi2 / 2);
  const double volume = std::pow(2 * std::numbers::pi, 1.5) * fit.spread;
  return chance * volume / (chance * volume + right);
}

bool contradicts_inertial(const FlightFilter& flight, const RelativeMotionMeasurement& measurement) {
  return flight.inertial() && flight.motion_chi2(measurement) > parameters::inertial::kMotionGate_chi2;
}

std::optional<double> CourseAmbiguity::on_step(bool turn_contradicted, double heading_sigma_rad, double step_m) {
  if (turn_contradicted) open_ = true;
  if (heading_sigma_rad < kResolvedHeading_rad) open_ = false;
  if (!open_) {
    astray_m_ = 0;
    return std::nullopt;
  }
  const double before_m = astray_m_;
  astray_m_ += kWrongCourseFactor * step_m;
  return std::sqrt(astray_m_ * astray_m_ - before_m * before_m);
}

}  // namespace nadir
