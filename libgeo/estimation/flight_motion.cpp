#include "estimation/flight_motion.hpp"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>

#include "geodesy/angles.hpp"

namespace nadir {
namespace {

using F = FlightFilter;

// Of what the velocity changed by, times the interval: nobody tells when within the interval it did.
constexpr double kUnknownMoment = 0.08;

double turn_of(const FlightPrediction& prediction, const F::State& before, bool turn_known) {
  return turn_known ? wrap_pi(prediction.now[F::heading] - before[F::heading]) : 0.0;
}

Eigen::Matrix2d clockwise(double angle) {
  Eigen::Matrix2d turned;
  turned << std::cos(angle), std::sin(angle), -std::sin(angle), std::cos(angle);
  return turned;
}

// White acceleration of this spread per root second over the interval.
void add_white_acceleration(F::Covariance& noise, double sigma_mps, double dt) {
  const double q = sigma_mps * sigma_mps;
  for (int axis = 0; axis < 2; ++axis) {
    const int p = F::east + axis, v = F::velocity_east + axis;
    noise(p, p) += q * dt * dt * dt / 3;
    noise(p, v) += q * dt * dt / 2;
    noise(v, p) += q * dt * dt / 2;
    noise(v, v) += q * dt;
  }
}

// A constant push has no state here. As white noise that grows with the time it is never taken for less: after t
// seconds t²/2 times the push of way, and 1.2 times what it did to the velocity.
double white_sigma_mps(const InertialDoubt& doubt, double dt) {
  const double growing = 3 * doubt.leak_mps2 * doubt.leak_mps2 * (doubt.blind_s + dt / 2);
  return std::sqrt(doubt.white_mps * doubt.white_mps + growing);
}

// It is one wind all the time: over a turn of many frames what does not turn adds up, it does not average out.
double turn_spread_rad2(double turned, double turn) {
  const double before = std::min(std::abs(turned), kPi), now = std::min(std::abs(turned + turn), kPi);
  return std::max(turn * turn, now * now - before * before);
}

}  // namespace

// The velocity turns with the aircraft, but for the wind; the position moves by the mean of both velocities.
void carry_by_velocity(FlightPrediction& prediction, const F::State& before, double dt, bool turn_known,
                       double blind_turn_rad, const F::Options& options) {
  auto& [now, transition, noise] = prediction;
  const double turn = turn_of(prediction, before, turn_known);
  const Eigen::Matrix2d turned = clockwise(turn);
  now.segment<2>(F::velocity_east) = turned * before.segment<2>(F::velocity_east);
  now.segment<2>(F::east) = before.segment<2>(F::east) + 0.5 * dt * (before + now).segment<2>(F::velocity_east);
  transition.block<2, 2>(F::velocity_east, F::velocity_east) = turned;
  Eigen::Matrix<double, 2, 1> across = Eigen::Vector2d::Zero();  // how an error of the turn turns the velocity
  if (turn_known) across << now[F::velocity_north], -now[F::velocity_east];
  transition.middleRows<2>(F::velocity_east) += across * transition.row(F::heading);
  transition.block<2, 1>(F::velocity_east, F::heading) -= across;
  transition.middleRows<2>(F::east) += 0.5 * dt * transition.middleRows<2>(F::velocity_east);
  transition.block<2, 2>(F::east, F::velocity_east) += 0.5 * dt * Eigen::Matrix2d::Identity();
  Eigen::Matrix<double, 4, 1> turning;
  turning << 0.5 * dt * across, across;
  noise.topLeftCorner<4, 4>() += noise(F::heading, F::heading) * turning * turning.transpose();
  noise.block<4, 1>(0, F::heading) += noise(F::heading, F::heading) * turning;
  noise.block<1, 4>(F::heading, 0) += noise(F::heading, F::heading) * turning.transpose();
  noise.block<4, 1>(0, F::deviation) += noise(F::heading, F::deviation) * turning;
  noise.block<1, 4>(F::deviation, 0) += noise(F::heading, F::deviation) * turning.transpose();
  if (dt <= 0) return;
  add_white_acceleration(noise, turn_known ? options.steady_acceleration_mps2 : options.acceleration_mps2, dt);
  const double q = options.wind_sigma_mps * options.wind_sigma_mps * turn_spread_rad2(blind_turn_rad, turn);
  for (int axis = 0; axis < 2; ++axis) {
    const int p = F::east + axis, v = F::velocity_east + axis;
    noise(p, p) += q * dt * dt / 4;
    noise(p, v) += q * dt / 2;
    noise(v, p) += q * dt / 2;
    noise(v, v) += q;
  }
}

// Who integrated the change of velocity turned it by the heading that the telemetry tells, with its lasting errors.
void carry_by_imu(FlightPrediction& prediction, const F::State& before, double dt, bool turn_known,
                  const Eigen::Vector2d& dv_mps, const InertialDoubt& doubt) {
  auto& [now, transition, noise] = prediction;
  const double turn = turn_of(prediction, before, turn_known);
  const Eigen::Vector2d dv = clockwise(before[F::heading_bias] + before[F::deviation]) * dv_mps;
  now.segment<2>(F::velocity_east) = before.segment<2>(F::velocity_east) + dv;
  now.segment<2>(F::east) = before.segment<2>(F::east) + 0.5 * dt * (before + now).segment<2>(F::velocity_east);
  const Eigen::Vector2d across(dv.y(), -dv.x());
  for (const int error : {F::heading_bias, F::deviation}) {
    transition.block<2, 1>(F::velocity_east, error) += across;
    transition.block<2, 1>(F::east, error) += 0.5 * dt * across;
  }
  transition.block<2, 2>(F::east, F::velocity_east) += dt * Eigen::Matrix2d::Identity();
  if (dt <= 0) return;
  add_white_acceleration(noise, white_sigma_mps(doubt, dt), dt);
  // A chord is longer than the mean of two velocities says: by a twelfth of the turn's square.
  const double arc_m = dt * now.segment<2>(F::velocity_east).norm() * turn * turn / 12;
  const double moment_m = std::max(kUnknownMoment * dv_mps.norm() * dt, arc_m);
  for (const int p : {F::east, F::north}) noise(p, p) += moment_m * moment_m;
}

// Flying back over a loop undoes what a wrong heading did, and the algebra knows. But the loop is believed, not seen.
void forbid_learning_blind(FlightPrediction& prediction, const F::Covariance& before) {
  const F::Covariance after = prediction.transition * before * prediction.transition.transpose() + prediction.noise;
  const Eigen::Matrix2d grown = (after - before).topLeftCorner<2, 2>();
  const double least = Eigen::SelfAdjointEigenSolver<Eigen::Matrix2d>(grown).eigenvalues()[0];
  if (least < 0) prediction.noise.topLeftCorner<2, 2>() -= least * Eigen::Matrix2d::Identity();
}

}  // namespace nadir
