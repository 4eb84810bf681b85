#include "estimation/inertial_preintegration.hpp"

#include <algorithm>
#include <cmath>

#include "vision/localizer_parameters.hpp"

namespace nadir {
namespace {

using namespace parameters::inertial;
using Eigen::Matrix3d;
using Eigen::Vector3d;

// Right Jacobian of SO(3): Exp(φ + δ) = Exp(φ) Exp(J δ) (8 in the paper).
Matrix3d right_jacobian(const Vector3d& vector_rad) {
  const Matrix3d cross = cross_matrix(vector_rad);
  const double square = vector_rad.squaredNorm();
  if (square < kSmallAngle_rad * kSmallAngle_rad) return Matrix3d::Identity() - cross / 2 + cross * cross / 6;
  const double angle = std::sqrt(square);
  return Matrix3d::Identity() - (1 - std::cos(angle)) / square * cross +
         (angle - std::sin(angle)) / (square * angle) * (cross * cross);
}

// One sample that holds for dt.
void add(PreintegratedMotion& sum, const InertialSample& sample, double dt) {
  const Vector3d turn = (sample.rate_rad_s - sum.bias.rate_rad_s) * dt;
  const Matrix3d step = rotation_of(turn), step_back = step.transpose(), jacobian = right_jacobian(turn);
  const Matrix3d middle = sum.turn * rotation_of(turn / 2);
  const Vector3d force = sample.force_mps2 - sum.bias.force_mps2;
  const Matrix3d lever = middle * cross_matrix(force);  // how an error of the turn moves the force
  const double half = dt * dt / 2;

  Eigen::Matrix<double, 9, 9> transition = Eigen::Matrix<double, 9, 9>::Identity();
  transition.block<3, 3>(0, 0) = step_back;
  transition.block<3, 3>(3, 0) = -lever * dt;
  transition.block<3, 3>(6, 0) = -lever * half;
  transition.block<3, 3>(6, 3) = dt * Matrix3d::Identity();
  const Eigen::Matrix<double, 9, 9> carried = transition * sum.covariance;
  sum.covariance = carried * transition.transpose();
  const double rate_variance = kRateNoise_rad_s * kRateNoise_rad_s * dt;
  const double force_variance = kForceNoise_mps2 * kForceNoise_mps2 * dt;
  sum.covariance.block<3, 3>(0, 0) += rate_variance * jacobian * jacobian.transpose();
  sum.covariance.block<3, 3>(3, 3) += force_variance * Matrix3d::Identity();
  sum.covariance.block<3, 3>(6, 6) += force_variance * dt * dt / 4 * Matrix3d::Identity();
  sum.covariance.block<3, 3>(3, 6) += force_variance * dt / 2 * Matrix3d::Identity();
  sum.covariance.block<3, 3>(6, 3) += force_variance * dt / 2 * Matrix3d::Identity();

  // The error of the turn at the middle of the sample, by the gyroscopes' bias.
  const Matrix3d turned_by_rate = sum.turn_by_rate - jacobian * dt / 2;
  sum.displacement_by_force += sum.velocity_by_force * dt - middle * half;
  sum.displacement_by_rate += sum.velocity_by_rate * dt - lever * half * turned_by_rate;
  sum.velocity_by_force -= middle * dt;
  sum.velocity_by_rate -= lever * dt * turned_by_rate;
  sum.turn_by_rate = (step_back * sum.turn_by_rate).eval() - jacobian * dt;

  sum.displacement_m += sum.velocity_change_mps * dt + middle * force * half;
  sum.velocity_change_mps += middle * force * dt;
  sum.turn = (sum.turn * step).eval();
  sum.seconds += dt;
}

}  // namespace

Matrix3d cross_matrix(const Vector3d& a) {
  Matrix3d cross;
  cross << 0, -a.z(), a.y(), a.z(), 0, -a.x(), -a.y(), a.x(), 0;
  return cross;
}

Matrix3d rotation_of(const Vector3d& vector_rad) {
  const Matrix3d cross = cross_matrix(vector_rad);
  const double square = vector_rad.squaredNorm();
  if (square < kSmallAngle_rad * kSmallAngle_rad) {
    return Matrix3d::Identity() + (1 - square / 6) * cross + cross * cross / 2;
  }
  const double angle = std::sqrt(square);
  return Matrix3d::Identity() + std::sin(angle) / angle * cross + (1 - std::cos(angle)) / square * (cross * cross);
}

Vector3d rotation_vector_of(const Matrix3d& r) {
  const Vector3d twice_sine(r(2, 1) - r(1, 2), r(0, 2) - r(2, 0), r(1, 0) - r(0, 1));
  const double sine = twice_sine.norm() / 2, cosine = (r.trace() - 1) / 2;
  const double angle = std::atan2(sine, cosine);
  return sine < kSmallAngle_rad ? Vector3d(twice_sine / 2) : Vector3d(twice_sine * (angle / (2 * sine)));
}

PreintegratedMotion PreintegratedMotion::with_bias(const InertialBias& other) const {
  PreintegratedMotion moved = *this;
  const Vector3d rate = other.rate_rad_s - bias.rate_rad_s, force = other.force_mps2 - bias.force_mps2;
  moved.bias = other;
  moved.turn = turn * rotation_of(turn_by_rate * rate);
  moved.velocity_change_mps += velocity_by_rate * rate + velocity_by_force * force;
  moved.displacement_m += displacement_by_rate * rate + displacement_by_force * force;
  return moved;
}

std::optional<PreintegratedMotion> preintegrate(std::span<const InertialSample> samples, double from_s, double to_s,
                                                const InertialBias& bias) {
  PreintegratedMotion sum;
  sum.bias = bias;
  double done_s = from_s;
  auto sample = std::ranges::upper_bound(samples, from_s, {}, &InertialSample::time_s);
  while (done_s < to_s) {
    const bool held = sample == samples.end();  // the last sample holds a little longer
    if (held && sample == samples.begin()) return std::nullopt;
    const InertialSample& now = held ? samples.back() : *sample;
    const double since_s = held ? now.time_s : done_s, until_s = held ? to_s : std::min(now.time_s, to_s);
    if ((held ? to_s : now.time_s) - since_s > kMaxGap_s) return std::nullopt;
    add(sum, now, until_s - done_s);
    done_s = until_s;
    if (!held) ++sample;
  }
  return sum.seconds > 0 ? std::optional(sum) : std::nullopt;
}

std::vector<PreintegratedMotion> preintegrate_parts(std::span<const InertialSample> samples, double from_s,
                                                    double to_s) {
  std::vector<PreintegratedMotion> parts;
  if (samples.empty() || !(to_s > from_s)) return parts;
  const double seconds = to_s - from_s;
  if (!(seconds < kMaxWay_s) || seconds > samples.back().time_s - samples.front().time_s + 3 * kMaxGap_s) return parts;
  const int count = std::max(1, static_cast<int>(std::ceil(seconds / kMaxPart_s)));
  double begin_s = from_s;
  for (int i = 1; i <= count; ++i) {
    const double end_s = i == count ? to_s : from_s + seconds * i / count;
    const auto part = preintegrate(samples, begin_s, end_s);
    if (!part) return {};
    parts.push_back(*part);
    begin_s = end_s;
  }
  return parts;
}

std::vector<InertialSample> usable_samples(std::span<const InertialSample> samples, double after_s) {
  std::vector<InertialSample> usable;
  for (const InertialSample& sample : samples) {
    const bool in_range = sample.rate_rad_s.cwiseAbs().maxCoeff() < kRateRange_rad_s &&
                          sample.force_mps2.cwiseAbs().maxCoeff() < kForceRange_mps2 && sample.rate_rad_s.allFinite() &&
                          sample.force_mps2.allFinite();
    const double last_s = usable.empty() ? after_s : usable.back().time_s;
    if (in_range && std::isfinite(sample.time_s) && sample.time_s > last_s) usable.push_back(sample);
  }
  return usable;
}

}  // namespace nadir
