#include "estimation/flight_filter.hpp"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <utility>

#include "geodesy/angles.hpp"
#include "vision/localizer_parameters.hpp"

namespace nadir {

// x_k = f(x_{k-1}), its Jacobian and the process noise: mean, F and Q of the header.
struct FlightPrediction {
  FlightFilter::State now;
  FlightFilter::Covariance transition = FlightFilter::Covariance::Identity();
  FlightFilter::Covariance noise = FlightFilter::Covariance::Zero();
};

namespace {

namespace model = parameters::telemetry;
using namespace parameters::flight_filter;
using F = FlightFilter;

// Products of views of any size, compiled once: Eigen's own of fixed sizes are instantiated for each pair of types,
// which takes a compiler most of a minute. The order of the operations is the same.
using View = Eigen::Ref<const Eigen::MatrixXd>;
Eigen::MatrixXd product(const View& a, const View& b) {
  Eigen::MatrixXd result(a.rows(), b.cols());
  result.noalias() = a * b;
  return result;
}
// a bᵀ, as (b aᵀ)ᵀ: the order in which Eigen adds up a product with a transposed matrix inside a sum.
Eigen::MatrixXd product_transposed(const View& a, const View& b) { return product(b, a.transpose()).transpose(); }
// A P Aᵀ
Eigen::MatrixXd congruence(const View& a, const View& p) { return product_transposed(product(a, p), a); }

// An aircraft cannot become arbitrarily fast, however long nothing was observed.
double max_velocity_variance(const FlightFilter::Options& options) {
  return kMaxVelocityVarianceRatio * options.start_velocity_sigma_mps * options.start_velocity_sigma_mps;
}

// One step of a first-order Gauss-Markov process: the factor on the old value, and the variance of the innovation.
struct GaussMarkov {
  double keep, variance;
};
GaussMarkov gauss_markov(double stationary_variance, double keep) {
  return {keep, stationary_variance * (1 - keep * keep)};
}

double turn_between(const FlightPrediction& prediction, const F::State& before, bool turn_known) {
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

// Errors of the accelerometer's change of velocity.
struct InertialNoise {
  double white_mps = 0;  // per root second
  // A constant error of attitude tilts gravity into the plane: an acceleration that stays, for blind_s already since
  // the velocity was last measured.
  double leak_mps2 = 0;
  double blind_s = 0;
};

// A constant acceleration has no state here. White noise that grows with time never underestimates it: after t seconds
// the position's σ is at least t²/2 times the acceleration, the velocity's 1.2 times its integral.
double white_sigma_mps(const InertialNoise& imu, double dt) {
  const double growing = 3 * imu.leak_mps2 * imu.leak_mps2 * (imu.blind_s + dt / 2);
  return std::sqrt(imu.white_mps * imu.white_mps + growing);
}

// The wind is the same all the time: over a turn of many frames its part of the velocity adds up, it does not average
// out.
double turn_spread_rad2(double turned, double turn) {
  const double before = std::min(std::abs(turned), kPi), now = std::min(std::abs(turned + turn), kPi);
  return std::max(turn * turn, now * now - before * before);
}

// Mean square of the speed over ground on whatever course: a wind of this spread adds to one course what it takes from
// the other. A velocity that is unknown is no faster than at the start.
double mean_square_speed_m2ps2(const F::State& mean, const F::Covariance& covariance, const F::Options& options) {
  const double start = options.start_velocity_sigma_mps * options.start_velocity_sigma_mps;
  return mean.segment<2>(F::velocity_east).squaredNorm() +
         std::min(covariance.block<2, 2>(F::velocity_east, F::velocity_east).trace(), 2 * start) +
         4 * options.wind_sigma_mps * options.wind_sigma_mps;
}

// After propagate_by_velocity(), whose p' = p + dt (v + v') / 2 becomes the header's p' = p + c (v + v') + w_gap.
void forget_course(FlightPrediction& prediction, const F::State& before, double dt, bool turn_known,
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
    x.segment<2>(F::east) += seconds * x.segment<2>(F::velocity_east);
    f.middleRows<2>(F::east) += seconds * f.middleRows<2>(F::velocity_east);
    q.middleRows<2>(F::east) += seconds * q.middleRows<2>(F::velocity_east);
    q.middleCols<2>(F::east) += seconds * q.middleCols<2>(F::velocity_east);
  };

  const Eigen::Vector2d both_mps = (before + now).segment<2>(F::velocity_east);
  now.segment<2>(F::east) -= lost_s * before.segment<2>(F::velocity_east);
  transition.block<2, 2>(F::east, F::velocity_east) -= lost_s * Eigen::Matrix2d::Identity();
  move_s(-lost_s);
  noise.topLeftCorner<2, 2>() += mean_square_speed * tau_s * (free_s - 2 * known_s) * Eigen::Matrix2d::Identity() +
                                 lost_s * lost_s / 3 * both_mps * both_mps.transpose();
  if (turn_known) return;

  // Nobody measured the course at both ends either: the velocity at this one is forgotten, and moves the position anew.
  const GaussMarkov velocity = gauss_markov(0.5 * mean_square_speed, std::exp(-free_s / tau_s));
  move_s(-c);
  now.segment<2>(F::velocity_east) *= velocity.keep;
  transition.middleRows<2>(F::velocity_east) *= velocity.keep;
  noise.middleRows<2>(F::velocity_east) *= velocity.keep;
  noise.middleCols<2>(F::velocity_east) *= velocity.keep;
  noise.block<2, 2>(F::velocity_east, F::velocity_east) += velocity.variance * Eigen::Matrix2d::Identity();
  move_s(c);
}

// The velocity turns with the aircraft, except for the wind; the position moves by the mean of both velocities.
void propagate_by_velocity(FlightPrediction& prediction, const F::State& before, double dt, bool turn_known,
                           double blind_turn_rad, const F::Options& options) {
  auto& [now, transition, noise] = prediction;
  const double turn = turn_between(prediction, before, turn_known);
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

// The change of velocity was rotated by the telemetry's heading, with its persistent errors.
void propagate_by_imu(FlightPrediction& prediction, const F::State& before, double dt, bool turn_known,
                      const Eigen::Vector2d& dv_mps, const InertialNoise& imu) {
  auto& [now, transition, noise] = prediction;
  const double turn = turn_between(prediction, before, turn_known);
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
  add_white_acceleration(noise, white_sigma_mps(imu, dt), dt);
  // An arc is longer than the mean of its two end velocities times the time: by a twelfth of the turn's square.
  const double arc_m = dt * now.segment<2>(F::velocity_east).norm() * turn * turn / 12;
  const double moment_m = std::max(kUnknownMomentShare * dv_mps.norm() * dt, arc_m);
  for (const int p : {F::east, F::north}) noise(p, p) += moment_m * moment_m;
}

// Closing a loop cancels the effect of a wrong heading, and so does the algebra. But the loop is predicted, not
// observed: flying alone must never make the position more certain in any direction.
void forbid_blind_certainty(FlightPrediction& prediction, const F::Covariance& before) {
  const F::Covariance after = congruence(prediction.transition, before) + prediction.noise;
  const Eigen::Matrix2d grown = (after - before).topLeftCorner<2, 2>();
  const double least = Eigen::SelfAdjointEigenSolver<Eigen::Matrix2d>(grown).eigenvalues()[0];
  if (least < 0) prediction.noise.topLeftCorner<2, 2>() -= least * Eigen::Matrix2d::Identity();
}

}  // namespace

FlightFilter::FlightFilter(const TelemetryUncertainty& uncertainty, bool tilt_logged, PlanePoint position,
                           double sigma_m, const Options& options)
    : uncertainty_(uncertainty), tilt_logged_(tilt_logged), options_(options) {
  const double white =
      (tilt_logged ? model::kWhiteTiltShareLogged : model::kWhiteTiltShareUnlogged) * uncertainty.tilt_rad;
  tilt_scatter_weight_ = kTiltScatterPriorFrames;
  tilt_scatter_sum_ = tilt_scatter_weight_ * white * white;
  mean_.segment<2>(east) = position.vector();
  const auto squared = [](double x) { return x * x; };
  covariance_.diagonal() << squared(sigma_m), squared(sigma_m), squared(options.start_velocity_sigma_mps),
      squared(options.start_velocity_sigma_mps), squared(uncertainty.agl_relative), model::kUnknownHeadingVariance_rad2,
      0, 0, squared(model::kHeadingBiasShare * uncertainty.heading_rad), squared(uncertainty.tilt_rad),
      squared(uncertainty.tilt_rad), squared(model::kDeviationShare * uncertainty.heading_rad),
      squared(model::kDeviationShare * uncertainty.heading_rad);
}

double FlightFilter::sigma(Index index) const { return std::sqrt(covariance_(index, index)); }
double FlightFilter::position_sigma_m() const { return std::sqrt(0.5 * position_covariance_m2().trace()); }
// A logged tilt scatters as the camera file states, or more; the scatter of an unlogged one is known from the frames
// only.
double FlightFilter::white_tilt_sigma_rad() const {
  const double least = tilt_logged_ ? model::kWhiteTiltShareLogged * uncertainty_.tilt_rad : kLeastWhiteTilt_rad;
  const double missing = tilt_missing_ ? kMissingTilt_rad : 0;
  return std::sqrt(std::max(least * least, tilt_scatter_sum_ / tilt_scatter_weight_) + missing * missing);
}

void FlightFilter::propagate(const TelemetryInterval& interval) {
  if (first_) return;  // there is nothing yet to propagate
  if (!interval.heading_rad && !interval.imu_dv_mps) {
    silent_s_ += interval.seconds;
    return;
  }
  propagate_joint(with_silence(interval), true);
  within_interval_ = true;
}

// The way through intervals that measured nothing is one with that to the next measurement, and no shorter gap. What an
// accelerometer measured is of its own interval alone.
TelemetryInterval FlightFilter::with_silence(TelemetryInterval interval) {
  const double silent_s = std::exchange(silent_s_, 0);
  if (silent_s > 0 && interval.imu_dv_mps) {
    propagate_joint({silent_s, std::nullopt, std::nullopt}, true);
    within_interval_ = true;
  } else {
    interval.seconds += silent_s;
  }
  return interval;
}

void FlightFilter::predict(double seconds, std::optional<double> measured_heading_rad, bool tilt_measured,
                           const std::optional<Eigen::Vector2d>& imu_dv_mps) {
  propagate_joint(with_silence({seconds, measured_heading_rad, imu_dv_mps}), tilt_measured);
  within_interval_ = false;
}

void FlightFilter::propagate_joint(const TelemetryInterval& interval, bool tilt_measured) {
  if (!within_interval_) marginalize_previous();
  tilt_missing_ = tilt_logged_ && !tilt_measured;
  const auto [now, transition, noise] = process_model(interval);
  const auto before = joint_;  // within a long interval: the joint density with the last frame
  const State last = before ? State(before->first.head<states>()) : mean_;
  const Covariance last_covariance = before ? Covariance(before->second.topLeftCorner<states, states>()) : covariance_;
  const Covariance cross =
      product(transition, before ? Covariance(before->second.bottomLeftCorner<states, states>()) : covariance_);
  const Covariance next = congruence(transition, covariance_) + noise;
  JointCovariance joint;
  joint << last_covariance, cross.transpose(), cross, next;
  const double ceiling = max_velocity_variance(options_);
  for (const int v : {states + velocity_east, states + velocity_north}) {
    if (joint(v, v) <= ceiling) continue;
    const double shrink = std::sqrt(ceiling / joint(v, v));
    joint.row(v) *= shrink;
    joint.col(v) *= shrink;
  }
  JointState both;
  both << last, now;
  mean_ = now;
  covariance_ = joint.bottomRightCorner<states, states>();
  if (!first_) joint_.emplace(both, joint);
  first_ = false;
}

FlightPrediction FlightFilter::process_model(const TelemetryInterval& interval) {
  const auto& [seconds, measured_heading_rad, imu_dv_mps] = interval;
  const bool clock_stopped = !first_ && !(seconds > 0);
  if (!first_ && seconds > 0) usual_seconds_ = std::min(seconds, kLongestUsualInterval_s);
  const double dt = first_ ? 0 : std::max(0.0, seconds);
  FlightPrediction prediction;
  auto& [now, transition, noise] = prediction;

  const double agl_variance = uncertainty_.agl_relative * uncertainty_.agl_relative;
  const GaussMarkov height = gauss_markov(
      agl_variance, first_ ? 1 : std::sqrt(1 - model::kHeightInnovationShare * model::kHeightInnovationShare));
  transition(log_height, log_height) = height.keep;
  noise(log_height, log_height) = height.variance;

  const double tilt_variance = uncertainty_.tilt_rad * uncertainty_.tilt_rad;
  const double drift_s = tilt_logged_ ? model::kTiltTimeLogged_s : model::kTiltTimeUnlogged_s;
  const GaussMarkov bias = gauss_markov(tilt_variance, std::exp(-dt / drift_s));
  const double white = white_tilt_sigma_rad() * white_tilt_sigma_rad();
  for (int axis = 0; axis < 2; ++axis) {
    const int tilt = pitch + axis, constant = pitch_bias + axis;
    transition(tilt, tilt) = 0;
    transition(tilt, constant) = transition(constant, constant) = bias.keep;
    noise(constant, constant) = noise(constant, tilt) = noise(tilt, constant) = bias.variance;
    noise(tilt, tilt) = bias.variance + white;
  }

  process_model_heading(prediction, measured_heading_rad, dt);

  now = (transition * mean_).eval();
  if (measured_heading_rad) now[heading] += *measured_heading_rad;

  const bool turn_known = measured_heading_rad && measured_heading_rad_;
  if (imu_dv_mps && !first_) {
    const double leak_mps2 = kGravity_mps2 * model::kLevelShare * uncertainty_.tilt_rad;
    propagate_by_imu(prediction, mean_, dt, turn_known, *imu_dv_mps, {uncertainty_.imu_dv_mps, leak_mps2, blind_s_});
  } else {
    propagate_by_velocity(prediction, mean_, dt, turn_known, blind_turn_rad_, options_);
    forget_course(prediction, mean_, dt, turn_known, mean_square_speed_m2ps2(mean_, covariance_, options_));
  }
  if (turn_known) blind_turn_rad_ += wrap_pi(now[heading] - mean_[heading]);
  blind_s_ += dt;
  if (clock_stopped) {
    const double step_m = usual_seconds_ * std::max(kStoppedClockSpeed_mps, now.segment<2>(velocity_east).norm());
    noise(east, east) += step_m * step_m;
    noise(north, north) += step_m * step_m;
  }
  if (imu_dv_mps && !first_) forbid_blind_certainty(prediction, covariance_);
  measured_heading_rad_ = measured_heading_rad;
  if (measured_heading_rad) last_measured_heading_rad_ = measured_heading_rad;
  return prediction;
}

// The deviation depends on the course: the error on this course and on the one 90 degrees to the right predict it.
void FlightFilter::process_model_heading(FlightPrediction& prediction,
                                         const std::optional<double>& measured_heading_rad, double dt) const {
  auto& [now, transition, noise] = prediction;
  if (!measured_heading_rad) {
    noise(heading, heading) = first_ ? 0 : model::kUnknownHeadingVariance_rad2;
    return;
  }
  const double turn = last_measured_heading_rad_ ? *measured_heading_rad - *last_measured_heading_rad_ : 0;
  const double deviation_rad = model::kDeviationShare * uncertainty_.heading_rad;
  const GaussMarkov deviation_process =
      gauss_markov(deviation_rad * deviation_rad, std::exp(-dt / model::kDeviationTime_s));
  const double c = deviation_process.keep * std::cos(turn), s = deviation_process.keep * std::sin(turn);
  transition(deviation, deviation) = transition(deviation_quadrature, deviation_quadrature) = c;
  transition(deviation, deviation_quadrature) = s;
  transition(deviation_quadrature, deviation) = -s;
  noise(deviation, deviation) = noise(deviation_quadrature, deviation_quadrature) = deviation_process.variance;

  const double white_rad = model::kWhiteHeadingShare * uncertainty_.heading_rad;
  transition(heading, heading) = 0;
  transition(heading, heading_bias) = 1;
  transition(heading, deviation) = c;
  transition(heading, deviation_quadrature) = s;
  noise(heading, heading) = deviation_process.variance + white_rad * white_rad;
  noise(heading, deviation) = noise(deviation, heading) = deviation_process.variance;
}

template <int Rows>
void FlightFilter::update_joint(const Eigen::Matrix<double, Rows, kJoint>& row,
                                const Eigen::Matrix<double, Rows, 1>& innovation,
                                const Eigen::Matrix<double, Rows, Rows>& noise) {
  auto& [both, joint] = *joint_;
  const Eigen::Matrix<double, Rows, kJoint> observed = product(row, joint);
  const Eigen::Matrix<double, Rows, Rows> spread = product_transposed(observed, row) + noise;
  const Eigen::Matrix<double, kJoint, Rows> gain = spread.ldlt().solve(observed).transpose();
  both += gain * innovation;
  const JointCovariance left = JointCovariance::Identity() - product(gain, row);
  joint = congruence(left, joint) + congruence(gain, noise);
  joint = (0.5 * (joint + joint.transpose())).eval();
  mean_ = both.template tail<states>();
  covariance_ = joint.template bottomRightCorner<states, states>();
}

// Iterated once (one step of an iterated EKF). The measured displacement alone is metres off where tilt is
// unknown, and is correlated with the very tilt that it measures: a Jacobian taken from it would be overconfident after
// a minute of odometry. So m of the header's equations is the displacement after a first update.
Eigen::Vector2d FlightFilter::update_relative(const RelativeMotionMeasurement& measurement) {
  if (!joint_) return Eigen::Vector2d::Zero();
  blind_turn_rad_ = blind_s_ = 0;
  const auto prior = *joint_;
  const Eigen::Vector2d predicted = prior.first.segment<2>(east);
  apply_relative_motion(measurement, measurement.value.head<2>());
  const Eigen::Vector2d m = joint_->first.segment<2>(states + east) - joint_->first.segment<2>(east);
  joint_ = prior;
  apply_relative_motion(measurement, m);
  return joint_->first.segment<2>(east) - predicted;
}

// m: the displacement that scale and heading act on (east, north; m).
void FlightFilter::apply_relative_motion(const RelativeMotionMeasurement& measurement, const Eigen::Vector2d& m) {
  constexpr int b = 0, n = states;  // the frame before, and now
  // z = H · (before, now) + offset, linear about the attitude and height that the front end worked with.
  Eigen::Matrix<double, 8, kJoint> row = Eigen::Matrix<double, 8, kJoint>::Zero();
  Eigen::Matrix<double, 8, 1> offset = Eigen::Matrix<double, 8, 1>::Zero();
  for (int axis = 0; axis < 2; ++axis) {
    row(axis, n + east + axis) = 1;
    row(axis, b + east + axis) = -1;
    row(axis, b + log_height) = -m[axis];
  }
  row(0, b + heading) = -m.y();  // clockwise: north turns into east
  row(1, b + heading) = m.x();
  offset.head<2>() =
      m * measurement.before.log_height + Eigen::Vector2d(m.y(), -m.x()) * measurement.before.heading_rad;
  row(2, n + log_height) = row(3, n + heading) = 1;
  row(2, b + log_height) = row(3, b + heading) = -1;
  offset[2] = -(measurement.now.log_height - measurement.before.log_height);
  offset[3] = -(measurement.now.heading_rad - measurement.before.heading_rad);
  row(4, b + pitch) = row(5, b + roll) = row(6, n + pitch) = row(7, n + roll) = 1;
  offset.tail<4>() << -measurement.before.pitch_rad, -measurement.before.roll_rad, -measurement.now.pitch_rad,
      -measurement.now.roll_rad;
  Eigen::Matrix<double, 8, 1> innovation = measurement.value - row * joint_->first - offset;
  innovation[3] = wrap_pi(innovation[3]);
  update_joint<8>(row, innovation, measurement.covariance);
}

void FlightFilter::reset_height(double log_sigma) {
  const auto reset = [log_sigma](auto& mean, auto& covariance, int index) {
    mean[index] = 0;
    covariance.row(index).setZero();
    covariance.col(index).setZero();
    covariance(index, index) = log_sigma * log_sigma;
  };
  reset(mean_, covariance_, log_height);
  if (joint_) reset(joint_->first, joint_->second, states + log_height);
}

// The velocity was estimated with that heading and would confirm it: it is reset.
void FlightFilter::inflate_heading(double sigma_rad) {
  marginalize_previous();
  const double variance = std::min(sigma_rad * sigma_rad, model::kUnknownHeadingVariance_rad2);
  for (const int i : {heading, heading_bias}) {
    for (const int j : {heading, heading_bias}) covariance_(i, j) += variance;
  }
  reset_velocity();
}

void FlightFilter::reset_velocity() {
  for (const int v : {velocity_east, velocity_north}) {
    covariance_.row(v).setZero();
    covariance_.col(v).setZero();
    covariance_(v, v) = max_velocity_variance(options_);
  }
}

void FlightFilter::inflate_position(double sigma_m) {
  marginalize_previous();
  covariance_.block<2, 2>(east, east) += sigma_m * sigma_m * Eigen::Matrix2d::Identity();
}

// The scatter of the tilts measured on the map, beyond the known covariances, is the white part's variance.
void FlightFilter::estimate_tilt_scatter(const PoseMeasurement& measurement) {
  const Eigen::Vector2d innovation = measurement.value.segment<2>(4) - mean_.segment<2>(pitch_bias);
  const double known = 0.5 * (covariance_.block<2, 2>(pitch_bias, pitch_bias).trace() +
                              measurement.covariance.block<2, 2>(4, 4).trace());
  const double white = white_tilt_sigma_rad() * white_tilt_sigma_rad();
  // Much more uncertain measurements have no information, and would only erode the sum.
  if (known < kVaguestTiltVarianceRatio * white) {
    const double weight = white / (white + known);
    tilt_scatter_sum_ += weight * (0.5 * innovation.squaredNorm() - known);
    tilt_scatter_weight_ += weight;
  }
  tilt_scatter_sum_ = std::max(tilt_scatter_sum_, 0.0);
}

void FlightFilter::update_absolute(const PoseMeasurement& measurement) {
  marginalize_previous();
  blind_turn_rad_ = blind_s_ = 0;
  estimate_tilt_scatter(measurement);
  constexpr int order[] = {east, north, log_height, heading, pitch, roll};
  Eigen::Matrix<double, 6, states> row = Eigen::Matrix<double, 6, states>::Zero();
  for (int i = 0; i < 6; ++i) row(i, order[i]) = 1;
  Eigen::Matrix<double, 6, 1> innovation = measurement.value - row * mean_;
  innovation[3] = wrap_pi(innovation[3]);
  const Eigen::Matrix<double, 6, states> observed = product(row, covariance_);
  const Eigen::Matrix<double, 6, 6> spread = product_transposed(observed, row) + measurement.covariance;
  const Eigen::Matrix<double, states, 6> gain = spread.ldlt().solve(observed).transpose();
  const double heading_before_rad = mean_[heading];
  mean_ += gain * innovation;
  const Covariance left = Covariance::Identity() - product(gain, row);
  const Eigen::Matrix<double, states, 6> weighted = gain * measurement.covariance;
  covariance_ = congruence(left, covariance_) + product_transposed(weighted, gain);
  covariance_ = (0.5 * (covariance_ + covariance_.transpose())).eval();
  // The velocity was estimated with the old heading; linearized there it does not apply to a far one.
  if (std::abs(wrap_pi(mean_[heading] - heading_before_rad)) > kNonlinearHeading_rad) reset_velocity();
}

// Keeps the conditional of the last frame given the current one, for smoothed().
void FlightFilter::marginalize_previous() {
  if (joint_ && links_) links_->push_back(link());
  joint_.reset();
}

FlightFilter::Link FlightFilter::link() const {
  const auto& [both, joint] = *joint_;
  Link link;
  link.before = both.head<states>();
  link.now = both.tail<states>();
  link.before_covariance = joint.topLeftCorner<states, states>();
  link.now_covariance = joint.bottomRightCorner<states, states>();
  const Covariance cross = joint.bottomLeftCorner<states, states>();
  link.gain = link.now_covariance.ldlt().solve(cross).transpose();
  return link;
}

std::vector<FlightFilter::Smoothed> FlightFilter::smoothed() const {
  std::vector<Link> links = links_.value_or(std::vector<Link>());
  if (joint_ && links_) links.push_back(link());
  std::vector<Smoothed> result(links.size() + 1);
  State mean = mean_;
  Covariance covariance = covariance_;
  for (std::size_t i = result.size(); i-- > 0;) {
    result[i] = {PlanePoint(mean.segment<2>(east)), covariance.block<2, 2>(east, east), mean};
    if (i == 0) break;
    const Link& link = links[i - 1];
    mean = (link.before + link.gain * (mean - link.now)).eval();
    covariance =
        link.before_covariance + product(product(link.gain, covariance - link.now_covariance), link.gain.transpose());
  }
  return result;
}

CameraPose camera_pose(const FlightFilter::State& x, const TelemetryReference& reference) {
  CameraPose pose;
  pose.position = {x[FlightFilter::east], x[FlightFilter::north]};
  pose.agl_m = reference.agl_m * std::exp(x[FlightFilter::log_height]);
  pose.attitude = {x[FlightFilter::heading], reference.tilt_rad.x() + x[FlightFilter::pitch],
                   reference.tilt_rad.y() + x[FlightFilter::roll]};
  return pose;
}

}  // namespace nadir
