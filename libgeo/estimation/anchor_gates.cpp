#include "estimation/anchor_gates.hpp"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>

namespace nadir {
namespace {

// What roofs and rolling ground within a footprint feign, however well tilt and height are known.
constexpr double kTiltModelError_rad = 0.015;
constexpr double kHeightModelError = 0.015;

}  // namespace

double attitude_surprise(const SolvedPose& solved, const AnchorPrior& prior) {
  const Attitude& found = solved.pose.attitude;
  const Attitude& believed = prior.search.pose.attitude;
  const Eigen::Vector2d tilt(found.pitch_rad - believed.pitch_rad, found.roll_rad - believed.roll_rad);
  const Eigen::Matrix2d tilt_spread =
      prior.tilt_covariance_rad2 + kTiltModelError_rad * kTiltModelError_rad * Eigen::Matrix2d::Identity();
  const double tilt_sigmas = std::sqrt(tilt.dot(tilt_spread.inverse() * tilt) / 2);
  const double height_sigmas = std::abs(std::log(solved.pose.agl_m / prior.search.pose.agl_m)) /
                               std::hypot(prior.log_agl_sigma, kHeightModelError);
  return std::max(tilt_sigmas, height_sigmas);
}

namespace {

// corroborated_closely: a sharp prediction says the same, and the patches agree closer than chance does.
double needed_inlier_share(double ratio, bool corroborated_closely, const GateLimits& limits) {
  if (ratio <= limits.clear_ratio) return limits.clear_inlier_share;
  if (ratio <= limits.alone_ratio || corroborated_closely) return limits.alone_inlier_share;
  return limits.vote_inlier_share;
}

// Where many places competed and hardly any came near, the ratio speaks for the place.
bool distinctive(const AnchorMatch& match, const AnchorPrior& prior, const GateLimits& limits) {
  return match.search.ratio <= limits.clear_ratio && prior.search.radius_m >= limits.telling_window_m;
}

// Few patches; or not many, which fit badly, lie where nobody expected them or have a camera that may be tilted any
// way.
bool chance_consensus(const AnchorMatch& match, const AnchorPrior& prior, double share, const Prediction& prediction,
               const GateLimits& limits) {
  if (share < limits.sure_inlier_share) return true;
  const double tilt_variance_rad2 = prior.tilt_covariance_rad2.trace() / 2;
  const bool loose = match.solved->rms_m > limits.max_chance_residual_px * match.fine_gsd_m;
  const bool open = tilt_variance_rad2 > limits.open_tilt_rad * limits.open_tilt_rad;
  const bool unexpected = !prediction.lost && prediction.chi2 > limits.expected_chi2;
  return share < limits.most_inlier_share && (loose || open || unexpected);
}

// So far from the start that one frame is not enough to say so.
bool doubts_start(const Prediction& prediction, const GateLimits& limits) {
  if (!prediction.first || prediction.lost) return false;
  return prediction.chi2 > (prediction.followed ? limits.chi2_99 : limits.expected_chi2);
}

}  // namespace

bool corroborated(const Prediction& prediction, const GateLimits& limits) {
  return prediction.healthy && prediction.sigma_m <= limits.sharp_sigma_m && prediction.chi2 <= limits.expected_chi2;
}

AnchorVerdict judge_anchor(const AnchorMatch& match, const AnchorPrior& prior, const Prediction& prediction,
                           const GateLimits& limits) {
  if (!match.on_map) return AnchorVerdict::no_map;
  if (match.search.places.empty() || match.search.ratio > limits.vote_ratio) return AnchorVerdict::ambiguous;
  const bool sharp = prediction.healthy && prediction.sigma_m <= limits.sharp_sigma_m;
  if (match.search.places.front().score < (sharp ? limits.min_sharp_score : limits.min_score)) {
    return AnchorVerdict::ambiguous;
  }
  if (!match.solved) return AnchorVerdict::few_inliers;
  const SolvedPose& solved = *match.solved;
  const double share = static_cast<double>(solved.inliers) / std::max(1, match.patches);
  const bool corroborated_closely =
      sharp && prediction.chi2 <= limits.chi2_999 && solved.rms_m <= limits.max_chance_residual_px * match.fine_gsd_m;
  if (solved.inliers < limits.min_inliers ||
      share < needed_inlier_share(match.search.ratio, corroborated_closely, limits)) {
    return AnchorVerdict::few_inliers;
  }
  if (match.frame_share < limits.min_frame_share) return AnchorVerdict::bad_geometry;
  if (solved.rms_m > limits.max_residual_px * match.fine_gsd_m) return AnchorVerdict::bad_geometry;
  if (attitude_surprise(solved, prior) > limits.max_tilt_sigmas) return AnchorVerdict::bad_geometry;
  if (!prediction.lost && prediction.chi2 > limits.chi2_999) return AnchorVerdict::off_prediction;
  const bool chance = !corroborated(prediction, limits) && !distinctive(match, prior, limits) &&
                      chance_consensus(match, prior, share, prediction, limits);
  const bool backed = prediction.healthy && prediction.sigma_m <= limits.healthy_sigma_m;
  const bool alone = prediction.lost ? match.search.ratio <= limits.lost_ratio && share >= limits.lost_inlier_share
                                     : match.search.ratio <= limits.alone_ratio || backed;
  return alone && !chance && !doubts_start(prediction, limits) && !prediction.torn ? AnchorVerdict::accepted
                                                                                   : AnchorVerdict::awaiting_votes;
}

}  // namespace nadir
