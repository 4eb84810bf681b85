#include "flights/segment_shape.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <variant>

#include "geodesy/angles.hpp"

namespace nadir {
namespace {

constexpr int kRotationIterations = 4;  // of a turn within 0.3 rad each leaves a hundredth of the error; numerical
constexpr double kStatedFreedom = 1;    // ν; the least for which two looks keep their share within 95 %, 25 Nov 2026
constexpr double kMostFactor = 64;      // of the looks' variances, either way; chosen
constexpr int kFactorSteps = 60;        // … in steps of 7 %

// A heading turns clockwise: (east, north) by the angle.
Eigen::Matrix2d clockwise(double angle_rad) {
  const double c = std::cos(angle_rad), s = std::sin(angle_rad);
  Eigen::Matrix2d turn;
  turn << c, s, -s, c;
  return turn;
}

// Of the two steps that a frame may have: from the frame before, and from the one before that, over an outlier.
const OdometryStep* step_of(const ObservedFrame& now, std::size_t frames_back) {
  std::size_t asked = 0;
  for (const VisionAnswer& answer : now.answers) {
    const auto* step = std::get_if<std::optional<OdometryStep>>(&answer);
    if (step == nullptr || ++asked != frames_back) continue;
    return *step ? &**step : nullptr;
  }
  return nullptr;
}

bool is_usable(const ObservedFrame& frame) {
  for (const VisionAnswer& answer : frame.answers) {
    if (const auto* check = std::get_if<FrameCheck>(&answer)) return check->usable();
  }
  return false;
}

ShapeFrame unlinked(const ObservedFrame& observed) {
  const Telemetry telemetry = plausible_telemetry(observed.telemetry, observed.estimate.time_s);
  ShapeFrame frame;
  frame.frame = observed.frame;
  frame.time_s = observed.estimate.time_s;
  frame.attitude = {observed.state.heading_rad, telemetry.pitch_rad.value_or(0), telemetry.roll_rad.value_or(0)};
  frame.agl_m = observed.state.agl_m;
  frame.tilt_measured = telemetry.pitch_rad && telemetry.roll_rad;
  frame.usable = is_usable(observed) && frame.agl_m > 0;
  if (observed.look.camera) frame.evidence = observed.look.log_likelihood_ratio;
  return frame;
}

}  // namespace

SegmentShape segment_shape(std::span<const ObservedFrame> observed, const TelemetryUncertainty& uncertainty) {
  SegmentShape shape;
  if (observed.empty()) return shape;
  shape.segment = observed.front().estimate.segment;
  shape.log_scale_sigma = uncertainty.agl_relative;
  shape.turn_sigma_rad = observed.front().state.heading_sigma_rad;
  std::optional<double> turn_to_measured_rad;  // from the headings of the shape to those of the estimates
  for (std::size_t i = 0; i < observed.size(); ++i) {
    const ObservedFrame& now = observed[i];
    ShapeFrame frame = unlinked(now);
    if (i > 0) {
      const ObservedFrame& before = observed[i - 1];
      const OdometryStep* step = step_of(now, now.frame - before.frame);
      if (step == nullptr) break;
      // The displacement has the directions and the scale that the frame before was predicted with; since then its own
      // odometry has corrected both.
      const ShapeFrame& last = shape.frames.back();
      const RelativeMotionMeasurement& motion = step->measurement;
      const double turned_rad = wrap_pi(last.attitude.heading_rad - motion.before.heading_rad);
      const auto measured_agl_m = plausible_telemetry(before.telemetry, before.estimate.time_s).agl_m;
      const double scale =
          measured_agl_m ? before.state.agl_m / (*measured_agl_m * std::exp(motion.before.log_height)) : 1.0;
      const Eigen::Matrix2d corrected = scale * clockwise(turned_rad);
      frame.offset_m = last.offset_m + corrected * step->displacement_m;
      frame.step_covariance_m2 = corrected * step->covariance_m2 * corrected.transpose();
      // Where only one of the two headings was measured, the images alone know the turn.
      const double turn_rad = before.telemetry.heading_rad && now.telemetry.heading_rad
                                  ? now.state.heading_rad - before.state.heading_rad
                                  : motion.now.heading_rad - motion.before.heading_rad + motion.value[3];
      frame.attitude.heading_rad = wrap_pi(last.attitude.heading_rad + turn_rad);
    }
    shape.frames.push_back(frame);
    shape.log_scale_sigma = std::max(shape.log_scale_sigma, now.state.agl_sigma_m / std::max(1.0, now.state.agl_m));
    if (!now.telemetry.heading_rad) continue;
    shape.turn_sigma_rad = std::min(shape.turn_sigma_rad, now.state.heading_sigma_rad);
    turn_to_measured_rad = wrap_pi(now.state.heading_rad - frame.attitude.heading_rad);
  }
  if (!turn_to_measured_rad || *turn_to_measured_rad == 0) return shape;
  const Eigen::Matrix2d turn = clockwise(*turn_to_measured_rad);
  for (ShapeFrame& frame : shape.frames) {
    frame.offset_m = turn * frame.offset_m;
    frame.step_covariance_m2 = turn * frame.step_covariance_m2 * turn.transpose();
    frame.attitude.heading_rad = wrap_pi(frame.attitude.heading_rad + *turn_to_measured_rad);
  }
  return shape;
}

SegmentSimilarity::SegmentSimilarity(const SegmentShape& shape, const Prior& prior)
    : shape_(shape), prior_(prior), turned_(clockwise(prior.turn_rad)) {
  Eigen::Matrix2d walked_m2 = Eigen::Matrix2d::Zero();
  for (const ShapeFrame& frame : shape.frames) {
    walked_m2 += turned_ * frame.step_covariance_m2 * turned_.transpose();
    walked_m2_.push_back(walked_m2);
  }
  const auto squared = [](double sigma) { return sigma * sigma; };
  prior_variance_ << squared(prior.position_sigma_m), squared(prior.position_sigma_m), squared(prior.turn_sigma_rad),
      squared(prior.log_scale_sigma);
}

Eigen::Vector2d SegmentSimilarity::way_m(std::size_t index) const {
  return turned_ * (shape_.frames[index].offset_m - shape_.frames[prior_.reference].offset_m);
}

Eigen::Vector2d SegmentSimilarity::place(std::size_t index, const Parameters& at) const {
  return prior_.position.vector() + at.head<2>() + std::exp(at[3]) * (clockwise(at[2]) * way_m(index));
}

SegmentSimilarity::Jacobian SegmentSimilarity::jacobian(std::size_t index, const Parameters& at) const {
  const Eigen::Vector2d way = std::exp(at[3]) * (clockwise(at[2]) * way_m(index));
  Jacobian jacobian;
  jacobian << 1, 0, way.y(), way.x(), 0, 1, -way.x(), way.y();
  return jacobian;
}

// Both ways begin at the reference frame: they share steps only where they lead to the same side.
Eigen::Matrix2d SegmentSimilarity::common_walk_m2(std::size_t one, std::size_t other) const {
  const std::size_t reference = prior_.reference;
  const auto [low, high] = std::minmax(one, other);
  if (low > reference) return walked_m2_[low] - walked_m2_[reference];
  if (high < reference) return walked_m2_[reference] - walked_m2_[high];
  return Eigen::Matrix2d::Zero();
}

Eigen::MatrixXd SegmentSimilarity::look_rows(const Parameters& at) const {
  Eigen::MatrixXd rows = Eigen::MatrixXd::Zero(static_cast<Eigen::Index>(3 * looks_.size()), 4);
  for (std::size_t i = 0; i < looks_.size(); ++i) {
    const auto row = static_cast<Eigen::Index>(3 * i);
    rows.middleRows<2>(row) = jacobian(looks_[i].index, at);
    rows(row + 2, 2) = 1;
  }
  return rows;
}

void SegmentSimilarity::add(const ShapeLook& look) {
  looks_.push_back(look);
  solve();
}

Eigen::VectorXd SegmentSimilarity::residuals(const Parameters& at) const {
  Eigen::VectorXd residual(static_cast<Eigen::Index>(3 * looks_.size()));
  for (std::size_t i = 0; i < looks_.size(); ++i) {
    const auto row = static_cast<Eigen::Index>(3 * i);
    const ShapeLook& look = looks_[i];
    residual.segment<2>(row) = look.position.vector() - place(look.index, at);
    const double expected_rad = shape_.frames[look.index].attitude.heading_rad + prior_.turn_rad + at[2];
    residual[row + 2] = wrap_pi(look.heading_rad - expected_rad);
  }
  return residual + look_rows(at) * at;  // about the prior, whose parameters are 0
}

Eigen::MatrixXd SegmentSimilarity::look_noise(double variance_factor) const {
  const auto size = static_cast<Eigen::Index>(3 * looks_.size());
  Eigen::MatrixXd noise = Eigen::MatrixXd::Zero(size, size);
  for (std::size_t i = 0; i < looks_.size(); ++i) {
    for (std::size_t j = 0; j < looks_.size(); ++j) {
      const auto row = static_cast<Eigen::Index>(3 * i), column = static_cast<Eigen::Index>(3 * j);
      noise.block<2, 2>(row, column) = common_walk_m2(looks_[i].index, looks_[j].index);
      if (i != j) continue;
      noise.block<2, 2>(row, row) += variance_factor * looks_[i].covariance_m2;
      noise(row + 2, row + 2) = looks_[i].heading_sigma_rad * looks_[i].heading_sigma_rad;
    }
  }
  return noise;
}

void SegmentSimilarity::solve() {
  const Eigen::MatrixXd noise = look_noise(1);
  solution_.setZero();
  for (int round = 0; round < kRotationIterations; ++round) {
    const Eigen::MatrixXd rows = look_rows(solution_);
    const Eigen::MatrixXd joint = rows * prior_variance_.asDiagonal() * rows.transpose() + noise;
    inverse_ = joint.ldlt().solve(Eigen::MatrixXd::Identity(noise.rows(), noise.cols()));
    weighted_ = inverse_ * residuals(solution_);
    solution_ = prior_variance_.asDiagonal() * (rows.transpose() * weighted_);
  }
}

void SegmentSimilarity::scale_looks_by_scatter() {
  if (looks_.empty()) return;
  const Eigen::MatrixXd rows = look_rows(solution_);
  const Eigen::MatrixXd by_parameters = rows * prior_variance_.asDiagonal() * rows.transpose();
  const Eigen::VectorXd residual = residuals(solution_);
  std::vector<double> factors, log_posterior;
  for (int step = -kFactorSteps; step <= kFactorSteps; ++step) {
    const double factor = std::pow(kMostFactor, static_cast<double>(step) / kFactorSteps);
    const Eigen::LLT<Eigen::MatrixXd> joint(by_parameters + look_noise(factor));
    const double log_determinant = 2 * joint.matrixLLT().diagonal().array().log().sum();
    factors.push_back(factor);
    log_posterior.push_back(
        -(log_determinant + residual.dot(joint.solve(residual)) + kStatedFreedom * (std::log(factor) + 1 / factor)) /
        2);
  }
  const double most = *std::max_element(log_posterior.begin(), log_posterior.end());
  double mean = 0, weights = 0;
  for (std::size_t i = 0; i < factors.size(); ++i) {
    const double weight = std::exp(log_posterior[i] - most);
    mean += weight * factors[i];
    weights += weight;
  }
  for (ShapeLook& look : looks_) look.covariance_m2 *= mean / weights;
  solve();
}

double SegmentSimilarity::turn_rad() const { return wrap_pi(prior_.turn_rad + solution_[2]); }

double SegmentSimilarity::log_scale() const { return solution_[3]; }

SegmentSimilarity::Pose SegmentSimilarity::pose(std::size_t index) const {
  // East, north, heading and log height of the frame, about the parameters.
  Eigen::Matrix4d rows = Eigen::Matrix4d::Zero();
  rows.topRows<2>() = jacobian(index, solution_);
  rows(2, 2) = rows(3, 3) = 1;
  Eigen::Matrix4d covariance = rows * prior_variance_.asDiagonal() * rows.transpose();
  covariance.topLeftCorner<2, 2>() += common_walk_m2(index, index);
  Eigen::Vector4d correction = Eigen::Vector4d::Zero();
  if (!looks_.empty()) {
    Eigen::MatrixXd cross = rows * prior_variance_.asDiagonal() * look_rows(solution_).transpose();
    for (std::size_t i = 0; i < looks_.size(); ++i) {
      cross.block<2, 2>(0, static_cast<Eigen::Index>(3 * i)) += common_walk_m2(index, looks_[i].index);
    }
    correction = cross * weighted_;
    covariance -= cross * inverse_ * cross.transpose();
  }
  const ShapeFrame& frame = shape_.frames[index];
  Pose pose;
  // What the linear model says of the rotation beyond its point of linearization is in place().
  const Eigen::Vector2d linear = rows.topRows<2>() * solution_;
  pose.position = PlanePoint(place(index, solution_) + correction.head<2>() - linear);
  pose.covariance_m2 = (covariance.topLeftCorner<2, 2>() + covariance.topLeftCorner<2, 2>().transpose()) / 2;
  pose.heading_rad = wrap_pi(frame.attitude.heading_rad + prior_.turn_rad + correction[2]);
  pose.heading_sigma_rad = std::sqrt(std::max(0.0, covariance(2, 2)));
  pose.agl_m = frame.agl_m * std::exp(correction[3]);
  pose.log_agl_sigma = std::sqrt(std::max(0.0, covariance(3, 3)));
  return pose;
}

}  // namespace nadir
