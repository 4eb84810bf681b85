#include "estimation/flight_filter.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>

#include "estimation/flight_motion.hpp"
#include "estimation/telemetry_model.hpp"
#include "geodesy/angles.hpp"

namespace nadir {
namespace {

namespace model = telemetry_model;

constexpr double kTiltScatterPriorFrames = 3;     // how many frames the prior of the changing part is worth
constexpr double kVaguestSight = 16;              // variance over the changing part's, to learn from it
constexpr double kMissingTilt_rad = 0.35;         // of an aircraft that tells it otherwise: a banked turn
constexpr double kFarHeading_rad = 0.5;           // more than linear thinking bears
constexpr double kLeastChangingTilt_rad = 0.004;  // a quarter of a degree: no mount is stiffer

using Index = FlightFilter::Index;

// An aircraft cannot become arbitrarily fast, however long nothing was seen.
double most_velocity_variance(const FlightFilter::Options& options) {
  return 4 * options.start_velocity_sigma_mps * options.start_velocity_sigma_mps;
}

}  // namespace

FlightFilter::FlightFilter(const TelemetryUncertainty& uncertainty, bool tilt_logged, const Eigen::Vector2d& position_m,
                           double sigma_m, const Options& options)
    : uncertainty_(uncertainty), tilt_logged_(tilt_logged), options_(options) {
  const double changing =
      (tilt_logged ? model::kChangingTiltLogged : model::kChangingTiltUnlogged) * uncertainty.tilt_rad;
  tilt_scatter_weight_ = kTiltScatterPriorFrames;
  tilt_scatter_sum_ = tilt_scatter_weight_ * changing * changing;
  mean_.segment<2>(east) = position_m;
  const auto squared = [](double x) { return x * x; };
  covariance_.diagonal() << squared(sigma_m), squared(sigma_m), squared(options.start_velocity_sigma_mps),
      squared(options.start_velocity_sigma_mps), squared(uncertainty.agl_relative), model::kUnknownHeadingVariance, 0,
      0, squared(model::kConstantHeading * uncertainty.heading_rad), squared(uncertainty.tilt_rad),
      squared(uncertainty.tilt_rad), squared(model::kDeviation * uncertainty.heading_rad),
      squared(model::kDeviation * uncertainty.heading_rad);
}

double FlightFilter::sigma(Index index) const { return std::sqrt(covariance_(index, index)); }
double FlightFilter::position_sigma_m() const { return std::sqrt(0.5 * position_covariance_m2().trace()); }
// A logged tilt scatters as its camera file says, or worse; of an unlogged one only the frames can tell.
double FlightFilter::changing_tilt_sigma_rad() const {
  const double least = tilt_logged_ ? model::kChangingTiltLogged * uncertainty_.tilt_rad : kLeastChangingTilt_rad;
  const double missing = tilt_missing_ ? kMissingTilt_rad : 0;
  return std::sqrt(std::max(least * least, tilt_scatter_sum_ / tilt_scatter_weight_) + missing * missing);
}

void FlightFilter::carry(const TelemetryInterval& stretch) {
  if (first_) return;  // nobody knows from where
  fly(stretch, true);
  on_the_way_ = true;
}

void FlightFilter::advance(double seconds, std::optional<double> measured_heading_rad, bool tilt_measured,
                           const std::optional<Eigen::Vector2d>& imu_dv_mps) {
  fly({seconds, measured_heading_rad, imu_dv_mps}, tilt_measured);
  on_the_way_ = false;
}

void FlightFilter::fly(const TelemetryInterval& stretch, bool tilt_measured) {
  if (!on_the_way_) settle();
  tilt_missing_ = tilt_logged_ && !tilt_measured;
  const auto [now, transition, noise] = foretell(stretch);
  const auto before = joint_;  // on the way: with what the last frame is still tied to
  const State last = before ? State(before->first.head<states>()) : mean_;
  const Covariance last_covariance = before ? Covariance(before->second.topLeftCorner<states, states>()) : covariance_;
  const Covariance cross =
      transition * (before ? Covariance(before->second.bottomLeftCorner<states, states>()) : covariance_);
  const Covariance next = transition * covariance_ * transition.transpose() + noise;
  JointCovariance joint;
  joint << last_covariance, cross.transpose(), cross, next;
  const double ceiling = most_velocity_variance(options_);
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

template <int Rows>
void FlightFilter::update_joint(const Eigen::Matrix<double, Rows, kJoint>& row,
                                const Eigen::Matrix<double, Rows, 1>& innovation,
                                const Eigen::Matrix<double, Rows, Rows>& noise) {
  auto& [both, joint] = *joint_;
  const Eigen::Matrix<double, Rows, Rows> spread = row * joint * row.transpose() + noise;
  const Eigen::Matrix<double, kJoint, Rows> gain = spread.ldlt().solve(row * joint).transpose();
  both += gain * innovation;
  const JointCovariance left = JointCovariance::Identity() - gain * row;
  joint = (left * joint * left.transpose() + gain * noise * gain.transpose()).eval();
  joint = (0.5 * (joint + joint.transpose())).eval();
  mean_ = both.template tail<states>();
  covariance_ = joint.template bottomRightCorner<states, states>();
}

// The sight alone is metres off, as far as tilt is unknown, and errs with the very tilt that it measures. What scale
// and heading do to the motion is therefore taken from the motion after a first update, not from the sight.
Eigen::Vector2d FlightFilter::moved(const RelativeMotionMeasurement& sight) {
  if (!joint_) return Eigen::Vector2d::Zero();
  blind_turn_rad_ = blind_s_ = 0;
  const auto prior = *joint_;
  const Eigen::Vector2d foretold = prior.first.segment<2>(east);
  take_motion(sight, sight.seen.head<2>());
  const Eigen::Vector2d step = joint_->first.segment<2>(states + east) - joint_->first.segment<2>(east);
  joint_ = prior;
  take_motion(sight, step);
  return joint_->first.segment<2>(east) - foretold;
}

// step: about how far it went (east, north; m).
void FlightFilter::take_motion(const RelativeMotionMeasurement& sight, const Eigen::Vector2d& step) {
  constexpr int b = 0, n = states;  // the frame before, and now
  // seen = row · (before, now) + offset, linear about the beliefs that the front end worked with.
  Eigen::Matrix<double, 8, kJoint> row = Eigen::Matrix<double, 8, kJoint>::Zero();
  Eigen::Matrix<double, 8, 1> offset = Eigen::Matrix<double, 8, 1>::Zero();
  for (int axis = 0; axis < 2; ++axis) {
    row(axis, n + east + axis) = 1;
    row(axis, b + east + axis) = -1;
    row(axis, b + log_height) = -step[axis];
  }
  row(0, b + heading) = -step.y();  // clockwise: north turns into east
  row(1, b + heading) = step.x();
  offset.head<2>() = step * sight.before.log_height + Eigen::Vector2d(step.y(), -step.x()) * sight.before.heading_rad;
  row(2, n + log_height) = row(3, n + heading) = 1;
  row(2, b + log_height) = row(3, b + heading) = -1;
  offset[2] = -(sight.now.log_height - sight.before.log_height);
  offset[3] = -(sight.now.heading_rad - sight.before.heading_rad);
  row(4, b + pitch) = row(5, b + roll) = row(6, n + pitch) = row(7, n + roll) = 1;
  offset.tail<4>() << -sight.before.pitch_rad, -sight.before.roll_rad, -sight.now.pitch_rad, -sight.now.roll_rad;
  Eigen::Matrix<double, 8, 1> innovation = sight.seen - row * joint_->first - offset;
  innovation[3] = wrap_pi(innovation[3]);
  update_joint<8>(row, innovation, sight.covariance);
}

void FlightFilter::doubt_height(double log_sigma) {
  const auto unlearn = [log_sigma](auto& mean, auto& covariance, int index) {
    mean[index] = 0;
    covariance.row(index).setZero();
    covariance.col(index).setZero();
    covariance(index, index) = log_sigma * log_sigma;
  };
  unlearn(mean_, covariance_, log_height);
  if (joint_) unlearn(joint_->first, joint_->second, states + log_height);
}

// The velocity was learnt with that heading, and would vouch for it: it is forgotten.
void FlightFilter::doubt_heading(double sigma_rad) {
  settle();
  const double variance = std::min(sigma_rad * sigma_rad, model::kUnknownHeadingVariance);
  for (const int i : {heading, heading_bias}) {
    for (const int j : {heading, heading_bias}) covariance_(i, j) += variance;
  }
  forget_velocity();
}

void FlightFilter::forget_velocity() {
  for (const int v : {velocity_east, velocity_north}) {
    covariance_.row(v).setZero();
    covariance_.col(v).setZero();
    covariance_(v, v) = most_velocity_variance(options_);
  }
}

void FlightFilter::doubt_position(double sigma_m) {
  settle();
  covariance_.block<2, 2>(east, east) += sigma_m * sigma_m * Eigen::Matrix2d::Identity();
}

// What the tilts seen on the map scatter beyond what is known to scatter is the changing part.
void FlightFilter::learn_tilt_scatter(const PoseMeasurement& sight) {
  const Eigen::Vector2d innovation = sight.seen.segment<2>(4) - mean_.segment<2>(pitch_bias);
  const double known =
      0.5 * (covariance_.block<2, 2>(pitch_bias, pitch_bias).trace() + sight.covariance.block<2, 2>(4, 4).trace());
  const double changing = changing_tilt_sigma_rad() * changing_tilt_sigma_rad();
  // Much vaguer sights say nothing, and would only wear the sum away.
  if (known < kVaguestSight * changing) {
    const double weight = changing / (changing + known);
    tilt_scatter_sum_ += weight * (0.5 * innovation.squaredNorm() - known);
    tilt_scatter_weight_ += weight;
  }
  tilt_scatter_sum_ = std::max(tilt_scatter_sum_, 0.0);
}

void FlightFilter::anchored(const PoseMeasurement& sight) {
  settle();
  blind_turn_rad_ = blind_s_ = 0;
  learn_tilt_scatter(sight);
  constexpr int order[] = {east, north, log_height, heading, pitch, roll};
  Eigen::Matrix<double, 6, states> row = Eigen::Matrix<double, 6, states>::Zero();
  for (int i = 0; i < 6; ++i) row(i, order[i]) = 1;
  Eigen::Matrix<double, 6, 1> innovation = sight.seen - row * mean_;
  innovation[3] = wrap_pi(innovation[3]);
  const Eigen::Matrix<double, 6, 6> spread = row * covariance_ * row.transpose() + sight.covariance;
  const Eigen::Matrix<double, states, 6> gain = spread.ldlt().solve(row * covariance_).transpose();
  const double heading_before_rad = mean_[heading];
  mean_ += gain * innovation;
  const Covariance left = Covariance::Identity() - gain * row;
  covariance_ = (left * covariance_ * left.transpose() + gain * sight.covariance * gain.transpose()).eval();
  covariance_ = (0.5 * (covariance_ + covariance_.transpose())).eval();
  // The velocity was learnt with the old heading, and what is linear about that is not true of a far one.
  if (std::abs(wrap_pi(mean_[heading] - heading_before_rad)) > kFarHeading_rad) forget_velocity();
}

// Keeps how the last frame hangs on the one in work, for smoothed().
void FlightFilter::settle() {
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
    result[i] = {mean.segment<2>(east), covariance.block<2, 2>(east, east), mean};
    if (i == 0) break;
    const Link& link = links[i - 1];
    mean = (link.before + link.gain * (mean - link.now)).eval();
    covariance =
        (link.before_covariance + link.gain * (covariance - link.now_covariance) * link.gain.transpose()).eval();
  }
  return result;
}

}  // namespace nadir
