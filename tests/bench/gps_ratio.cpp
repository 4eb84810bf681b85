#include "gps_ratio.hpp"

#include <algorithm>
#include <cmath>

namespace nadir::bench {
namespace {

using Eigen::RowVector2d;
using Eigen::Vector2d;

constexpr double kSlowTime_s = 60, kVisionTime_s = 20, kWhiteShare = 0.05;
constexpr double kMapErrorSigma_m = 2;
constexpr double kWindow_s = 90, kSpacing_s = 2;
constexpr double kLevelTime_s = 120, kLeastLevel = 0.1;
constexpr double kMostSigmas = 3;  // of an innovation: one look accuses nobody

}  // namespace

void OnsetRatio::add(double time_s, const Vector2d& difference_m, double receiver_sigma_m, double vision_sigma_m) {
  const double dt_s = std::max(0.0, time_s - std::max(time_s_, time_s - 1e3));
  const Vector2d keep(std::exp(-dt_s / kSlowTime_s), std::exp(-dt_s / kVisionTime_s));
  state_ = keep.asDiagonal() * state_;
  covariance_ = keep.asDiagonal() * covariance_ * keep.asDiagonal();
  covariance_ += Vector2d(1 - keep[0] * keep[0], 1 - keep[1] * keep[1]).asDiagonal();

  const double white_m2 = kWhiteShare * vision_sigma_m * vision_sigma_m;
  const RowVector2d seen(std::sqrt(receiver_sigma_m * receiver_sigma_m + kMapErrorSigma_m * kMapErrorSigma_m),
                         std::sqrt(1 - kWhiteShare) * vision_sigma_m);
  const double variance_m2 = (seen * covariance_ * seen.transpose())(0) + white_m2;
  const Vector2d gain = covariance_ * seen.transpose() / variance_m2;
  RowVector2d innovation_m = difference_m.transpose() - seen * state_;
  const double most_m = kMostSigmas * std::sqrt(level_ * variance_m2);
  if (innovation_m.norm() > most_m) innovation_m *= most_m / innovation_m.norm();
  state_ += gain * innovation_m;
  covariance_ -= variance_m2 * gain * gain.transpose();
  const double weight = 1 - std::exp(-std::min(dt_s, 1.0) / kLevelTime_s);
  level_ = std::max(kLeastLevel, level_ + weight * (innovation_m.squaredNorm() / (2 * variance_m2) - level_));

  if (time_s >= next_onset_s_) {
    next_onset_s_ = time_s + kSpacing_s;
    for (const bool drift : {false, true}) onsets_.push_back({.since_s = time_s, .drift = drift});
  }
  while (time_s - onsets_.front().since_s > kWindow_s) onsets_.pop_front();
  for (Onset& onset : onsets_) {
    onset.response = keep.asDiagonal() * onset.response;
    const double g = (onset.drift ? time_s - onset.since_s : 1.0) - (seen * onset.response)(0);
    onset.response += gain * g;
    onset.information += g * g / variance_m2;
    onset.score += g / variance_m2 * innovation_m.transpose();
  }
  time_s_ = time_s;
}

double OnsetRatio::statistic() const {
  double largest = 0;
  for (const Onset& onset : onsets_) {
    if (onset.information > 0) largest = std::max(largest, onset.score.squaredNorm() / onset.information);
  }
  return largest / level_;
}

}  // namespace nadir::bench
