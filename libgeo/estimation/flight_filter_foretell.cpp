// What the flight filter expects of the next frame before it has looked at it: how the telemetry's errors wander, and
// how the aircraft flies on.
#include <algorithm>
#include <cmath>

#include "estimation/flight_filter.hpp"
#include "estimation/flight_motion.hpp"
#include "estimation/telemetry_model.hpp"
#include "geodesy/angles.hpp"

namespace nadir {
namespace {

namespace model = telemetry_model;

constexpr double kUsualSpeed_mps = 20;  // at least assumed, when the clock stands
constexpr double kLongestUsual_s = 5;
constexpr double kGravity_mps2 = 9.80665;

// A first-order Gauss-Markov process: what is kept of the old value, and the variance that comes anew.
struct Wander {
  double keep, variance;
};
Wander wander(double stationary_variance, double keep) { return {keep, stationary_variance * (1 - keep * keep)}; }

}  // namespace

FlightPrediction FlightFilter::foretell(const TelemetryInterval& stretch) {
  const auto& [seconds, measured_heading_rad, imu_dv_mps] = stretch;
  const bool clock_stands = !first_ && !(seconds > 0);
  if (!first_ && seconds > 0) usual_seconds_ = std::min(seconds, kLongestUsual_s);
  const double dt = first_ ? 0 : std::max(0.0, seconds);
  FlightPrediction prediction;
  auto& [now, transition, noise] = prediction;

  const double agl_variance = uncertainty_.agl_relative * uncertainty_.agl_relative;
  const Wander height = wander(agl_variance, first_ ? 1 : std::sqrt(1 - model::kHeightWander * model::kHeightWander));
  transition(log_height, log_height) = height.keep;
  noise(log_height, log_height) = height.variance;

  const double tilt_variance = uncertainty_.tilt_rad * uncertainty_.tilt_rad;
  const double drift_s = tilt_logged_ ? model::kTiltTimeLogged_s : model::kTiltTimeUnlogged_s;
  const Wander bias = wander(tilt_variance, std::exp(-dt / drift_s));
  const double changing = changing_tilt_sigma_rad() * changing_tilt_sigma_rad();
  for (int axis = 0; axis < 2; ++axis) {
    const int tilt = pitch + axis, constant = pitch_bias + axis;
    transition(tilt, tilt) = 0;
    transition(tilt, constant) = transition(constant, constant) = bias.keep;
    noise(constant, constant) = noise(constant, tilt) = noise(tilt, constant) = bias.variance;
    noise(tilt, tilt) = bias.variance + changing;
  }

  foretell_heading(prediction, measured_heading_rad, dt);

  now = (transition * mean_).eval();
  if (measured_heading_rad) now[heading] += *measured_heading_rad;

  const bool turn_known = measured_heading_rad && measured_heading_rad_;
  if (imu_dv_mps && !first_) {
    const double leak_mps2 = kGravity_mps2 * model::kLevel * uncertainty_.tilt_rad;
    carry_by_imu(prediction, mean_, dt, turn_known, *imu_dv_mps, {uncertainty_.imu_dv_mps, leak_mps2, blind_s_});
  } else {
    carry_by_velocity(prediction, mean_, dt, turn_known, blind_turn_rad_, options_);
  }
  if (turn_known) blind_turn_rad_ += wrap_pi(now[heading] - mean_[heading]);
  blind_s_ += dt;
  if (clock_stands) {
    const double step_m = usual_seconds_ * std::max(kUsualSpeed_mps, now.segment<2>(velocity_east).norm());
    noise(east, east) += step_m * step_m;
    noise(north, north) += step_m * step_m;
  }
  if (imu_dv_mps && !first_) forbid_learning_blind(prediction, covariance_);
  measured_heading_rad_ = measured_heading_rad;
  if (measured_heading_rad) last_measured_heading_rad_ = measured_heading_rad;
  return prediction;
}

// On another course the compass errs otherwise: what is known of this one and of the one abeam tells how.
void FlightFilter::foretell_heading(FlightPrediction& prediction, const std::optional<double>& measured_heading_rad,
                                    double dt) const {
  auto& [now, transition, noise] = prediction;
  if (!measured_heading_rad) {
    noise(heading, heading) = first_ ? 0 : model::kUnknownHeadingVariance;
    return;
  }
  const double turn = last_measured_heading_rad_ ? *measured_heading_rad - *last_measured_heading_rad_ : 0;
  const double deviation_rad = model::kDeviation * uncertainty_.heading_rad;
  const Wander wandering = wander(deviation_rad * deviation_rad, std::exp(-dt / model::kDeviationTime_s));
  const double c = wandering.keep * std::cos(turn), s = wandering.keep * std::sin(turn);
  transition(deviation, deviation) = transition(deviation_quadrature, deviation_quadrature) = c;
  transition(deviation, deviation_quadrature) = s;
  transition(deviation_quadrature, deviation) = -s;
  noise(deviation, deviation) = noise(deviation_quadrature, deviation_quadrature) = wandering.variance;

  const double changing_rad = model::kChangingHeading * uncertainty_.heading_rad;
  transition(heading, heading) = 0;
  transition(heading, heading_bias) = 1;
  transition(heading, deviation) = c;
  transition(heading, deviation_quadrature) = s;
  noise(heading, heading) = wandering.variance + changing_rad * changing_rad;
  noise(heading, deviation) = noise(deviation, heading) = wandering.variance;
}

}  // namespace nadir
