#include "estimation/flight_process_model.hpp"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>

#include "estimation/matrix_products.hpp"
#include "geodesy/angles.hpp"

namespace nadir {
namespace {

namespace model = parameters::telemetry;
using namespace parameters::flight_filter;
using S = FlightState;

// One step of a first-order Gauss-Markov process: the factor on the old value, and the variance of the innovation.
struct GaussMarkov {
  double keep, variance;
};
GaussMarkov gauss_markov(double stationary_variance, double keep) {
  return {keep, stationary_variance * (1 - keep * keep)};
}

double turn_between(const FlightPrediction& prediction, const S::Vector& before, bool turn_known) {
  return turn_known ? wrap_pi(prediction.now[S::heading] - before[S::heading]) : 0.0;
}

Eigen::Matrix2d clockwise(double angle) {
  Eigen::Matrix2d turned;
  turned << std::cos(angle), std::sin(angle), -std::sin(angle), std::cos(angle);
  return turned;
}

// White acceleration of this spread per root second over the interval.
void add_white_acceleration(S::Covariance& noise, double sigma_mps, double dt) {
  const double q = sigma_mps * sigma_mps;
  for (int axis = 0; axis < 2; ++axis) {
    const int p = S::east + axis, v = S::velocity_east + axis;
    noise(p, p) += q * dt * dt * dt / 3;
    noise(p, v) += q * dt * dt / 2;
    noise(v, p) += q * dt * dt / 2;
    noise(v, v) += q * dt;
  }
}

// The wind is the same all the time: over a turn of many frames its part of the velocity adds up, it does not average
// out.
double turn_spread_rad2(double turned, double turn) {
  const double before = std::min(std::abs(turned), kPi), now = std::min(std::abs(turned + turn), kPi);
  return std::max(turn * turn, now * now - before * before);
}

// Mean square of the speed over ground on whatever course: a wind of this spread adds to one course what it takes from
// the other. A velocity that is unknown is no faster than at the start.
double mean_square_speed_m2ps2(const S::Vector& mean, const S::Covariance& covariance,
                               const FlightFilterOptions& options) {
  const double start = options.start_velocity_sigma_mps * options.start_velocity_sigma_mps;
  return mean.segment<2>(S::velocity_east).squaredNorm() +
         std::min(covariance.block<2, 2>(S::velocity_east, S::velocity_east).trace(), 2 * start) +
         4 * options.wind_sigma_mps * options.wind_sigma_mps;
}

// After propagate_by_velocity(), whose p' = p + dt (v + v') / 2 becomes the header's p' = p + c (v + v') + w_gap.
void forget_course(FlightPrediction& prediction, const S::Vector& before, double dt, bool turn_known,
                   double mean_square_speed) {
  auto& [now, transition, noise] = prediction;
  const double free_s = dt - kCourseHeld_s;
  if (free_s <= 0) return;
  const double half_circle_s = kPi * std::sqrt(mean_square_speed) / (kGravity_mps2 * std::tan(kMaxBank_rad));
  const double tau_s = std::max(half_circle_s, free_s / kLeastKnownBridge);
  const double known_s = tau_s * std::tanh(free_s / (2 * tau_s));
  const double lost_s = 0.5 * free_s - known_s, c = 0.5 * dt - lost_s;
  // Adds to the position what the velocity at the end makes in so many seconds.
  const auto move_s = [&x = prediction.now, &f = prediction.transition, &q = prediction.noise](double seconds) {
    x.segment<2>(S::east) += seconds * x.segment<2>(S::velocity_east);
    f.middleRows<2>(S::east) += seconds * f.middleRows<2>(S::velocity_east);
    q.middleRows<2>(S::east) += seconds * q.middleRows<2>(S::velocity_east);
    q.middleCols<2>(S::east) += seconds * q.middleCols<2>(S::velocity_east);
  };

  const Eigen::Vector2d both_mps = (before + now).segment<2>(S::velocity_east);
  now.segment<2>(S::east) -= lost_s * before.segment<2>(S::velocity_east);
  transition.block<2, 2>(S::east, S::velocity_east) -= lost_s * Eigen::Matrix2d::Identity();
  move_s(-lost_s);
  noise.topLeftCorner<2, 2>() += mean_square_speed * tau_s * (free_s - 2 * known_s) * Eigen::Matrix2d::Identity() +
                                 lost_s * lost_s / 3 * both_mps * both_mps.transpose();
  if (turn_known) return;

  // Nobody measured the course at both ends either: the velocity at this one is forgotten, and moves the position anew.
  const GaussMarkov velocity = gauss_markov(0.5 * mean_square_speed, std::exp(-free_s / tau_s));
  move_s(-c);
  now.segment<2>(S::velocity_east) *= velocity.keep;
  transition.middleRows<2>(S::velocity_east) *= velocity.keep;
  noise.middleRows<2>(S::velocity_east) *= velocity.keep;
  noise.middleCols<2>(S::velocity_east) *= velocity.keep;
  noise.block<2, 2>(S::velocity_east, S::velocity_east) += velocity.variance * Eigen::Matrix2d::Identity();
  move_s(c);
}

// The velocity turns with the aircraft, except for the wind; the position moves by the mean of both velocities.
void propagate_by_velocity(FlightPrediction& prediction, const S::Vector& before, double dt, bool turn_known,
                           double blind_turn_rad, const FlightFilterOptions& options) {
  auto& [now, transition, noise] = prediction;
  const double turn = turn_between(prediction, before, turn_known);
  const Eigen::Matrix2d turned = clockwise(turn);
  now.segment<2>(S::velocity_east) = turned * before.segment<2>(S::velocity_east);
  now.segment<2>(S::east) = before.segment<2>(S::east) + 0.5 * dt * (before + now).segment<2>(S::velocity_east);
  transition.block<2, 2>(S::velocity_east, S::velocity_east) = turned;
  Eigen::Matrix<double, 2, 1> across = Eigen::Vector2d::Zero();  // how an error of the turn turns the velocity
  if (turn_known) across << now[S::velocity_north], -now[S::velocity_east];
  transition.middleRows<2>(S::velocity_east) += across * transition.row(S::heading);
  transition.block<2, 1>(S::velocity_east, S::heading) -= across;
  transition.middleRows<2>(S::east) += 0.5 * dt * transition.middleRows<2>(S::velocity_east);
  transition.block<2, 2>(S::east, S::velocity_east) += 0.5 * dt * Eigen::Matrix2d::Identity();
  Eigen::Matrix<double, 4, 1> turning;
  turning << 0.5 * dt * across, across;
  noise.topLeftCorner<4, 4>() += noise(S::heading, S::heading) * turning * turning.transpose();
  noise.block<4, 1>(0, S::heading) += noise(S::heading, S::heading) * turning;
  noise.block<1, 4>(S::heading, 0) += noise(S::heading, S::heading) * turning.transpose();
  noise.block<4, 1>(0, S::deviation) += noise(S::heading, S::deviation) * turning;
  noise.block<1, 4>(S::deviation, 0) += noise(S::heading, S::deviation) * turning.transpose();
  if (dt <= 0) return;
  add_white_acceleration(noise, turn_known ? options.steady_acceleration_mps2 : options.acceleration_mps2, dt);
  const double q = options.wind_sigma_mps * options.wind_sigma_mps * turn_spread_rad2(blind_turn_rad, turn);
  for (int axis = 0; axis < 2; ++axis) {
    const int p = S::east + axis, v = S::velocity_east + axis;
    noise(p, p) += q * dt * dt / 4;
    noise(p, v) += q * dt / 2;
    noise(v, p) += q * dt / 2;
    noise(v, v) += q;
  }
}

// The change of velocity was rotated by the telemetry's heading, with its persistent errors.
void propagate_by_imu(FlightPrediction& prediction, const S::Vector& before, double dt, bool turn_known,
                      const Eigen::Vector2d& dv_mps, double white_sigma_mps) {
  auto& [now, transition, noise] = prediction;
  const double turn = turn_between(prediction, before, turn_known);
  const Eigen::Vector2d dv = clockwise(before[S::heading_bias] + before[S::deviation]) * dv_mps;
  now.segment<2>(S::velocity_east) = before.segment<2>(S::velocity_east) + dv;
  now.segment<2>(S::east) = before.segment<2>(S::east) + 0.5 * dt * (before + now).segment<2>(S::velocity_east);
  const Eigen::Vector2d across(dv.y(), -dv.x());
  for (const int error : {S::heading_bias, S::deviation}) {
    transition.block<2, 1>(S::velocity_east, error) += across;
    transition.block<2, 1>(S::east, error) += 0.5 * dt * across;
  }
  transition.block<2, 2>(S::east, S::velocity_east) += dt * Eigen::Matrix2d::Identity();
  if (dt <= 0) return;
  add_white_acceleration(noise, white_sigma_mps, dt);
  // An arc is longer than the mean of its two end velocities times the time: by a twelfth of the turn's square.
  const double arc_m = dt * now.segment<2>(S::velocity_east).norm() * turn * turn / 12;
  const double moment_m = std::max(kUnknownMomentShare * dv_mps.norm() * dt, arc_m);
  for (const int p : {S::east, S::north}) noise(p, p) += moment_m * moment_m;
}

}  // namespace

FlightPrediction FlightProcessModel::predict(const S::Vector& mean, const S::Covariance& covariance,
                                             const TelemetryInterval& interval, double white_tilt_rad) {
  const auto& [seconds, measured_heading_rad, imu_dv_mps] = interval;
  const bool first = !begun_;
  const bool clock_stopped = !first && !(seconds > 0);
  if (!first && seconds > 0) usual_seconds_ = std::min(seconds, kLongestUsualInterval_s);
  const double dt = first ? 0 : std::max(0.0, seconds);
  FlightPrediction prediction;
  auto& [now, transition, noise] = prediction;

  predict_height_and_tilt(prediction, dt, white_tilt_rad);
  predict_heading(prediction, measured_heading_rad, dt);

  now = (transition * mean).eval();
  if (measured_heading_rad) now[S::heading] += *measured_heading_rad;

  const bool turn_known = measured_heading_rad && measured_heading_rad_;
  if (imu_dv_mps && !first) {
    propagate_by_imu(prediction, mean, dt, turn_known, *imu_dv_mps, imu_dv_sigma_mps(uncertainty_, blind_s_, dt));
  } else {
    propagate_by_velocity(prediction, mean, dt, turn_known, blind_turn_rad_, options_);
    forget_course(prediction, mean, dt, turn_known, mean_square_speed_m2ps2(mean, covariance, options_));
  }
  if (turn_known) blind_turn_rad_ += wrap_pi(now[S::heading] - mean[S::heading]);
  blind_s_ += dt;
  if (clock_stopped) {
    const double step_m = usual_seconds_ * std::max(kStoppedClockSpeed_mps, now.segment<2>(S::velocity_east).norm());
    noise(S::east, S::east) += step_m * step_m;
    noise(S::north, S::north) += step_m * step_m;
  }
  if (imu_dv_mps && !first) {
    const double certainty_m2 = blind_certainty_m2(covariance, congruence(transition, covariance) + noise);
    noise.topLeftCorner<2, 2>() += certainty_m2 * Eigen::Matrix2d::Identity();
  }
  on_measured_heading(measured_heading_rad);
  begun_ = true;
  return prediction;
}

FlightPrediction FlightProcessModel::predict_beside_inertial(const S::Vector& mean, double seconds, double turn_rad,
                                                             double white_tilt_rad) {
  usual_seconds_ = std::min(seconds, kLongestUsualInterval_s);
  blind_s_ += seconds;
  blind_turn_rad_ += turn_rad;
  FlightPrediction prediction;
  predict_height_and_tilt(prediction, seconds, white_tilt_rad);
  predict_deviation(prediction, turn_rad, seconds);
  for (int axis = 0; axis < 2; ++axis) prediction.transition(S::east + axis, S::velocity_east + axis) = seconds;
  prediction.now = prediction.transition * mean;
  return prediction;
}

void FlightProcessModel::on_measured_heading(const std::optional<double>& heading_rad) {
  measured_heading_rad_ = heading_rad;
  if (heading_rad) last_measured_heading_rad_ = heading_rad;
}

void FlightProcessModel::predict_height_and_tilt(FlightPrediction& prediction, double dt, double white_tilt_rad) const {
  auto& [now, transition, noise] = prediction;
  const double agl_variance = uncertainty_.agl_relative * uncertainty_.agl_relative;
  const GaussMarkov height = gauss_markov(
      agl_variance, !begun_ ? 1 : std::sqrt(1 - model::kHeightInnovationShare * model::kHeightInnovationShare));
  transition(S::log_height, S::log_height) = height.keep;
  noise(S::log_height, S::log_height) = height.variance;

  const double tilt_variance = uncertainty_.tilt_rad * uncertainty_.tilt_rad;
  const double drift_s = tilt_logged_ ? model::kTiltTimeLogged_s : model::kTiltTimeUnlogged_s;
  const GaussMarkov bias = gauss_markov(tilt_variance, std::exp(-dt / drift_s));
  const double white = white_tilt_rad * white_tilt_rad;
  for (int axis = 0; axis < 2; ++axis) {
    const int tilt = S::pitch + axis, constant = S::pitch_bias + axis;
    transition(tilt, tilt) = 0;
    transition(tilt, constant) = transition(constant, constant) = bias.keep;
    noise(constant, constant) = noise(constant, tilt) = noise(tilt, constant) = bias.variance;
    noise(tilt, tilt) = bias.variance + white;
  }
}

// The deviation depends on the course: the error on this course and on the one 90 degrees to the right predict it.
void FlightProcessModel::predict_heading(FlightPrediction& prediction,
                                         const std::optional<double>& measured_heading_rad, double dt) const {
  auto& [now, transition, noise] = prediction;
  if (!measured_heading_rad) {
    noise(S::heading, S::heading) = !begun_ ? 0 : model::kUnknownHeadingVariance_rad2;
    return;
  }
  const double turn = last_measured_heading_rad_ ? *measured_heading_rad - *last_measured_heading_rad_ : 0;
  const double deviation_variance = predict_deviation(prediction, turn, dt);
  const double c = transition(S::deviation, S::deviation), s = transition(S::deviation, S::deviation_quadrature);

  const double white_rad = model::kWhiteHeadingShare * uncertainty_.heading_rad;
  transition(S::heading, S::heading) = 0;
  transition(S::heading, S::heading_bias) = 1;
  transition(S::heading, S::deviation) = c;
  transition(S::heading, S::deviation_quadrature) = s;
  noise(S::heading, S::heading) = deviation_variance + white_rad * white_rad;
  noise(S::heading, S::deviation) = noise(S::deviation, S::heading) = deviation_variance;
}

// Returns the variance of its innovation.
double FlightProcessModel::predict_deviation(FlightPrediction& prediction, double turn, double dt) const {
  auto& [now, transition, noise] = prediction;
  const double deviation_rad = model::kDeviationShare * uncertainty_.heading_rad;
  const GaussMarkov deviation_process =
      gauss_markov(deviation_rad * deviation_rad, std::exp(-dt / model::kDeviationTime_s));
  const double c = deviation_process.keep * std::cos(turn), s = deviation_process.keep * std::sin(turn);
  transition(S::deviation, S::deviation) = transition(S::deviation_quadrature, S::deviation_quadrature) = c;
  transition(S::deviation, S::deviation_quadrature) = s;
  transition(S::deviation_quadrature, S::deviation) = -s;
  noise(S::deviation, S::deviation) = noise(S::deviation_quadrature, S::deviation_quadrature) =
      deviation_process.variance;
  return deviation_process.variance;
}

double imu_dv_sigma_mps(const TelemetryUncertainty& uncertainty, double blind_s, double dt) {
  const double leak_mps2 = kGravity_mps2 * model::kLevelShare * uncertainty.tilt_rad;
  const double growing = 3 * leak_mps2 * leak_mps2 * (blind_s + dt / 2);
  return std::sqrt(uncertainty.imu_dv_mps * uncertainty.imu_dv_mps + growing);
}

double blind_certainty_m2(const S::Covariance& before, const S::Covariance& after) {
  const Eigen::Matrix2d grown = (after - before).topLeftCorner<2, 2>();
  const double least = Eigen::SelfAdjointEigenSolver<Eigen::Matrix2d>(grown).eigenvalues()[0];
  return std::max(0.0, -least);
}

}  // namespace nadir
