#include "estimation/flight_filter.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

#include "estimation/matrix_products.hpp"
#include "geodesy/angles.hpp"
#include "geodesy/hypotenuse.hpp"
#include "vision/localizer_parameters.hpp"

namespace nadir {
namespace {

namespace model = parameters::telemetry;
using namespace parameters::flight_filter;

// What a PoseMeasurement measures, in its order.
constexpr std::array<int, 6> kPose = {FlightState::east,    FlightState::north, FlightState::log_height,
                                      FlightState::heading, FlightState::pitch, FlightState::roll};

// An aircraft cannot become arbitrarily fast, however long nothing was observed.
double max_velocity_variance(const FlightFilter::Options& options) {
  return kMaxVelocityVarianceRatio * options.start_velocity_sigma_mps * options.start_velocity_sigma_mps;
}

// Of the inertial sensor's errors, before anything is learned of them; of the attitude none.
Eigen::Matrix<double, StrapdownStep::kErrors, 1> unknown_calibration_variance() {
  using namespace parameters::inertial;
  Eigen::Matrix<double, StrapdownStep::kErrors, 1> variance = Eigen::Matrix<double, StrapdownStep::kErrors, 1>::Zero();
  variance.segment<3>(StrapdownStep::rate_bias).array() = kRateBias_rad_s * kRateBias_rad_s;
  variance.segment<3>(StrapdownStep::force_bias).array() = kForceBias_mps2 * kForceBias_mps2;
  variance.tail<9>().array() = kRateScale * kRateScale;
  return variance;
}

}  // namespace

FlightFilter::FlightFilter(const TelemetryUncertainty& uncertainty, bool tilt_logged, PlanePoint position,
                           double sigma_m, const Options& options)
    : uncertainty_(uncertainty),
      tilt_logged_(tilt_logged),
      options_(options),
      process_model_(uncertainty, tilt_logged, options) {
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
  if (!process_model_.begun()) return;  // there is nothing yet to propagate
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
  end_inertial();  // the attitude is unknown from here on
  if (!within_interval_) marginalize_previous();
  tilt_missing_ = tilt_logged_ && !tilt_measured;
  const bool first = !process_model_.begun();
  const auto [now, transition, noise] = process_model_.predict(mean_, covariance_, interval, white_tilt_sigma_rad());
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
  if (!first) joint_.emplace(both, joint);
}

// ---- The inertial sensor

void FlightFilter::set_latitude(double latitude_rad) {
  earth_rate_rad_s_ =
      parameters::inertial::kEarthRate_rad_s * Eigen::Vector3d(0, std::cos(latitude_rad), std::sin(latitude_rad));
}

// The attitude is the camera's, as it was just estimated, and as wrong as that.
void FlightFilter::begin_inertial(const Eigen::Vector2d& measured_tilt_rad) {
  using namespace parameters::inertial;
  if (inertial_ || inertial_refused_ >= kMaxSensorRefused || !(sigma(heading) < kStartHeading_rad)) return;
  Inertial begun;
  begun.world_from_sensor =
      world_from_sensor(mean_[heading], measured_tilt_rad.x() + mean_[pitch], measured_tilt_rad.y() + mean_[roll]);
  Eigen::Matrix<double, kErrors, states> by_state = Eigen::Matrix<double, kErrors, states>::Zero();
  const Eigen::Matrix3d by_angles = attitude_error_by_angles(mean_[heading]);
  by_state.block<3, 1>(0, heading) = by_angles.col(0);
  by_state.block<3, 1>(0, pitch) = by_angles.col(1);
  by_state.block<3, 1>(0, roll) = by_angles.col(2);
  begun.cross = product_transposed(covariance_, by_state);
  begun.covariance = congruence(by_state, covariance_);
  if (calibration_prior_) begun.calibration = calibration_prior_->mean;
  const InertialError variance = calibration_prior_ ? calibration_prior_->variance : unknown_calibration_variance();
  begun.covariance.diagonal().tail<kErrors - 3>() = variance.tail<kErrors - 3>();
  if (joint_) begun.cross_before = product_transposed(joint_->second.topRightCorner<states, states>(), by_state);
  inertial_ = begun;
}

void FlightFilter::end_inertial() {
  using namespace parameters::inertial;
  if (!inertial_) return;
  calibration_prior_ = {
      inertial_->calibration,
      (kBiasKeptVarianceRatio * inertial_->covariance.diagonal()).cwiseMin(unknown_calibration_variance())};
  inertial_.reset();
}

void FlightFilter::refuse_inertial(double sigma_m) {
  inflate_position(sigma_m);
  reset_velocity();
  calibration_prior_.reset();
  ++inertial_refused_;
}

void FlightFilter::propagate(const PreintegratedMotion& motion) {
  propagate_joint(motion, true);
  within_interval_ = true;
}

void FlightFilter::predict(const PreintegratedMotion& motion, std::optional<double> measured_heading_rad,
                           const std::optional<Eigen::Vector2d>& measured_tilt_rad) {
  propagate_joint(motion, measured_tilt_rad.has_value());
  within_interval_ = false;
  if (measured_tilt_rad) update_attitude(*measured_tilt_rad, rotation_vector_of(motion.turn).norm() / motion.seconds);
  process_model_.on_measured_heading(measured_heading_rad);
  if (measured_heading_rad) update_measured_heading(*measured_heading_rad);
}

void FlightFilter::propagate_joint(const PreintegratedMotion& motion, bool tilt_measured) {
  if (!within_interval_) marginalize_previous();
  tilt_missing_ = tilt_logged_ && !tilt_measured;
  silent_s_ = 0;
  const StrapdownStep step = strapdown_step(inertial_->world_from_sensor, motion, inertial_->calibration,
                                            mean_.segment<2>(velocity_east), earth_rate_rad_s_);
  constexpr int order[] = {east, north, velocity_east, velocity_north, heading};
  auto [now, transition, noise] = process_model_.predict_beside_inertial(
      mean_, motion.seconds, step.added[StrapdownStep::heading], white_tilt_sigma_rad());
  InertialCross by_errors = InertialCross::Zero(), noise_with_errors = InertialCross::Zero();
  for (int i = 0; i < 5; ++i) {
    now[order[i]] += step.added[i];
    by_errors.row(order[i]) = step.added_by_errors.row(i);
    noise_with_errors.row(order[i]) = step.noise.block<1, kErrors>(i, StrapdownStep::errors);
    for (int j = 0; j < 5; ++j) noise(order[i], order[j]) += step.noise(i, j);
  }

  // Of (x_last, x', e'), x' = F x + G e + w and e' = A e + w_e.
  Inertial& errors = *inertial_;
  const auto before = joint_;
  const State last = before ? State(before->first.head<states>()) : mean_;
  const Covariance last_covariance = before ? Covariance(before->second.topLeftCorner<states, states>()) : covariance_;
  const Covariance last_with_current =
      before ? Covariance(before->second.topRightCorner<states, states>()) : covariance_;
  const InertialCross last_with_errors = before ? errors.cross_before : errors.cross;
  const Covariance last_with_now =
      product_transposed(last_with_current, transition) + product_transposed(last_with_errors, by_errors);
  const InertialCross moved = product(transition, errors.cross) + product(by_errors, errors.covariance);
  const Covariance half = product_transposed(product(transition, errors.cross), by_errors);
  Covariance next =
      congruence(transition, covariance_) + half + half.transpose() + congruence(by_errors, errors.covariance) + noise;
  next.topLeftCorner<2, 2>() += blind_certainty_m2(covariance_, next) * Eigen::Matrix2d::Identity();

  errors.cross_before = product_transposed(last_with_errors, step.error_transition);
  errors.cross = product_transposed(moved, step.error_transition) + noise_with_errors;
  errors.covariance =
      congruence(step.error_transition, errors.covariance) + step.noise.bottomRightCorner<kErrors, kErrors>();
  errors.world_from_sensor = step.world_from_sensor;
  JointState both;
  both << last, now;
  JointCovariance joint;
  joint << last_covariance, last_with_now, last_with_now.transpose(), next;
  mean_ = now;
  covariance_ = next;
  joint_.emplace(both, joint);
}

// z = ψ - b_ψ - d + w
void FlightFilter::update_measured_heading(double measured_heading_rad) {
  Eigen::Matrix<double, 1, kJoint> row = Eigen::Matrix<double, 1, kJoint>::Zero();
  row[states + heading] = 1;
  row[states + heading_bias] = row[states + deviation] = -1;
  const double white_rad = model::kWhiteHeadingShare * uncertainty_.heading_rad;
  const double predicted_rad = (row * joint_->first)[0];
  update_joint<1>(row, Eigen::Matrix<double, 1, 1>(wrap_pi(measured_heading_rad - predicted_rad)),
                  Eigen::Matrix<double, 1, 1>(white_rad * white_rad));
}

// 0 = angles of R - those of the camera + w
void FlightFilter::update_attitude(const Eigen::Vector2d& measured_tilt_rad, double rate_rad_s) {
  using Cross = Eigen::Matrix<double, kJoint, kErrors>;
  auto& [both, joint] = *joint_;
  Inertial& errors = *inertial_;
  const Eigen::Vector3d angles = camera_angles(errors.world_from_sensor);
  Eigen::Matrix<double, 3, kJoint> row = Eigen::Matrix<double, 3, kJoint>::Zero();
  row(0, states + heading) = row(1, states + pitch) = row(2, states + roll) = 1;
  Eigen::Matrix<double, 3, kErrors> by_errors = Eigen::Matrix<double, 3, kErrors>::Zero();
  by_errors.leftCols<3>() = -attitude_error_by_angles(angles[0]).transpose();
  Eigen::Vector3d innovation(angles[0] - both[states + heading],
                             angles[1] - measured_tilt_rad.x() - both[states + pitch],
                             angles[2] - measured_tilt_rad.y() - both[states + roll]);
  innovation[0] = wrap_pi(innovation[0]);
  Cross cross;
  cross << errors.cross_before, errors.cross;
  const Eigen::Matrix<double, 3, kJoint> seen = product(row, joint) + product_transposed(by_errors, cross);
  const Eigen::Matrix<double, 3, kErrors> errors_seen = product(row, cross) + product(by_errors, errors.covariance);
  const double noise_rad =
      hypotenuse(parameters::inertial::kAttitudeNoise_rad, parameters::inertial::kFrameTime_s * rate_rad_s);
  const Eigen::Matrix3d spread = product_transposed(seen, row) + product_transposed(errors_seen, by_errors) +
                                 noise_rad * noise_rad * Eigen::Matrix3d::Identity();
  const Eigen::Matrix<double, kJoint, 3> gain = spread.ldlt().solve(seen).transpose();
  const Eigen::Matrix<double, kErrors, 3> errors_gain = spread.ldlt().solve(errors_seen).transpose();
  both += gain * innovation;
  joint -= product(gain, seen);
  joint = (0.5 * (joint + joint.transpose())).eval();
  cross -= product(gain, errors_seen);
  errors.cross_before = cross.topRows<states>();
  errors.cross = cross.bottomRows<states>();
  errors.covariance -= product(errors_gain, errors_seen);
  errors.covariance = (0.5 * (errors.covariance + errors.covariance.transpose())).eval();
  move_inertial(errors_gain * innovation);
  mean_ = both.tail<states>();
  covariance_ = joint.bottomRightCorner<states, states>();
}

void FlightFilter::move_inertial(const InertialError& error) {
  inertial_->world_from_sensor = (rotation_of(error.head<3>()) * inertial_->world_from_sensor).eval();
  InertialCalibration& calibration = inertial_->calibration;
  calibration.bias.rate_rad_s += error.segment<3>(StrapdownStep::rate_bias);
  calibration.bias.force_mps2 += error.segment<3>(StrapdownStep::force_bias);
  for (int axis = 0; axis < 3; ++axis) {
    calibration.rate_scale.col(axis) += error.segment<3>(StrapdownStep::rate_scale + 3 * axis);
  }
}

template <int Rows>
void FlightFilter::update_joint(const Eigen::Matrix<double, Rows, kJoint>& row,
                                const Eigen::Matrix<double, Rows, 1>& innovation,
                                const Eigen::Matrix<double, Rows, Rows>& noise) {
  auto& [both, joint] = *joint_;
  const Eigen::Matrix<double, Rows, kJoint> observed = product(row, joint);
  const Eigen::Matrix<double, Rows, Rows> spread = product_transposed(observed, row) + noise;
  const Eigen::Matrix<double, kJoint, Rows> gain = spread.ldlt().solve(observed).transpose();
  if (inertial_) {
    Eigen::Matrix<double, kJoint, kErrors> cross;
    cross << inertial_->cross_before, inertial_->cross;
    const Eigen::Matrix<double, Rows, kErrors> seen = product(row, cross);
    const Eigen::Matrix<double, kErrors, Rows> inertial_gain = spread.ldlt().solve(seen).transpose();
    cross -= product(gain, seen);
    inertial_->cross_before = cross.template topRows<kStates>();
    inertial_->cross = cross.template bottomRows<kStates>();
    inertial_->covariance -= product(inertial_gain, seen);
    inertial_->covariance = (0.5 * (inertial_->covariance + inertial_->covariance.transpose())).eval();
    move_inertial(inertial_gain * innovation);
  }
  both += gain * innovation;
  const JointCovariance left = JointCovariance::Identity() - product(gain, row);
  joint = congruence(left, joint) + congruence(gain, noise);
  joint = (0.5 * (joint + joint.transpose())).eval();
  mean_ = both.template tail<kStates>();
  covariance_ = joint.template bottomRightCorner<kStates, kStates>();
}

// Iterated once (one step of an iterated EKF). The measured displacement alone is metres off where tilt is
// unknown, and is correlated with the very tilt that it measures: a Jacobian taken from it would be overconfident after
// a minute of odometry. So m of the header's equations is the displacement after a first update.
Eigen::Vector2d FlightFilter::update_relative(const RelativeMotionMeasurement& measurement) {
  if (!joint_) return Eigen::Vector2d::Zero();
  process_model_.on_velocity_measured();
  const auto prior = *joint_;
  const auto prior_inertial = inertial_;
  const Eigen::Vector2d predicted = prior.first.segment<2>(east);
  apply_relative_motion(measurement, measurement.value.head<2>());
  const Eigen::Vector2d m = joint_->first.segment<2>(states + east) - joint_->first.segment<2>(east);
  joint_ = prior;
  inertial_ = prior_inertial;
  apply_relative_motion(measurement, m);
  return joint_->first.segment<2>(east) - predicted;
}

// m: the displacement that scale and heading act on (east, north; m).
std::pair<FlightFilter::Motion8Row, FlightFilter::Motion8> FlightFilter::relative_innovation(
    const RelativeMotionMeasurement& measurement, const Eigen::Vector2d& m) const {
  constexpr int b = 0, n = states;  // the frame before, and now
  // z = H · (before, now) + offset, linear about the attitude and height that the front end worked with.
  Motion8Row row = Motion8Row::Zero();
  Motion8 offset = Motion8::Zero();
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
  Motion8 innovation = measurement.value - row * joint_->first - offset;
  innovation[3] = wrap_pi(innovation[3]);
  return {row, innovation};
}

void FlightFilter::apply_relative_motion(const RelativeMotionMeasurement& measurement, const Eigen::Vector2d& m) {
  const auto [row, innovation] = relative_innovation(measurement, m);
  update_joint<8>(row, innovation, measurement.covariance);
}

FlightFilter::MotionFit FlightFilter::motion_fit(const RelativeMotionMeasurement& measurement) const {
  if (!joint_) return {};
  const auto [row, innovation] = relative_innovation(measurement, measurement.value.head<2>());
  const Eigen::Matrix<double, 8, 8> spread =
      product_transposed(product(row, joint_->second), row) + measurement.covariance;
  constexpr int of[] = {0, 1, 3};  // displacement and turn
  Eigen::Matrix3d part;
  Eigen::Vector3d off;
  for (int i = 0; i < 3; ++i) {
    off[i] = innovation[of[i]];
    for (int j = 0; j < 3; ++j) part(i, j) = spread(of[i], of[j]);
  }
  return {off.dot(part.ldlt().solve(off)), std::sqrt(std::max(0.0, part.determinant()))};
}

double FlightFilter::motion_innovation_m(const RelativeMotionMeasurement& measurement) const {
  if (!joint_) return 0;
  const Motion8 innovation = relative_innovation(measurement, measurement.value.head<2>()).second;
  return hypotenuse(innovation[0], innovation[1]);
}

double FlightFilter::turn_sigma_rad() const {
  if (!joint_) return sigma(heading);
  const JointCovariance& joint = joint_->second;
  constexpr int b = heading, n = states + heading;
  return std::sqrt(std::max(0.0, joint(n, n) - joint(n, b) - joint(b, n) + joint(b, b)));
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
  if (inertial_) inertial_->cross.row(log_height).setZero();
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
  end_inertial();
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

Eigen::Matrix<double, 6, 6> FlightFilter::pose_covariance() const { return covariance_(kPose, kPose); }

void FlightFilter::update_absolute(const PoseMeasurement& measurement) {
  marginalize_previous();
  process_model_.on_velocity_measured();
  estimate_tilt_scatter(measurement);
  Eigen::Matrix<double, 6, states> row = Eigen::Matrix<double, 6, states>::Zero();
  for (int i = 0; i < 6; ++i) row(i, kPose[static_cast<std::size_t>(i)]) = 1;
  Eigen::Matrix<double, 6, 1> innovation = measurement.value - row * mean_;
  innovation[3] = wrap_pi(innovation[3]);
  const Eigen::Matrix<double, 6, states> observed = product(row, covariance_);
  const Eigen::Matrix<double, 6, 6> spread = product_transposed(observed, row) + measurement.covariance;
  const Eigen::Matrix<double, states, 6> gain = spread.ldlt().solve(observed).transpose();
  if (inertial_) {
    const Eigen::Matrix<double, 6, kErrors> seen = product(row, inertial_->cross);
    const Eigen::Matrix<double, kErrors, 6> inertial_gain = spread.ldlt().solve(seen).transpose();
    inertial_->cross -= product(gain, seen);
    inertial_->covariance -= product(inertial_gain, seen);
    inertial_->covariance = (0.5 * (inertial_->covariance + inertial_->covariance.transpose())).eval();
    move_inertial(inertial_gain * innovation);
  }
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
