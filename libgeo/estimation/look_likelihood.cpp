#include "estimation/look_likelihood.hpp"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <numeric>

#include "base/error.hpp"
#include "estimation/look_likelihood_table.hpp"
#include "geodesy/hypotenuse.hpp"

namespace nadir {
namespace {

// As matching_plan() and search_window() choose them.
double distinct_places(const AnchorMatch& match, double searched_area_m2) {
  const double distinct_m = std::max(kDistinct_m, kDistinct_px * match.coarse_gsd_m);
  const double least_side_m = 2 * kMinWindowDistinct * distinct_m;
  return std::max(searched_area_m2, least_side_m * least_side_m) / (distinct_m * distinct_m);
}

double poses_tried(const SearchPrior& search) {
  const double headings = 1 + 2 * search.heading_range_rad / kHeadingStep_rad;
  const double heights = 1 + 2 * search.scale_range / kScaleStep;
  return headings * heights;
}

// Between the ground points that two cameras look at. Beyond the horizon there is none: then between the cameras.
double axis_shift_m(const CameraPose& a, const CameraPose& b) {
  const Eigen::Vector3d axis(0, 0, 1);
  const auto ground_a = ground_from_ray(a, axis), ground_b = ground_from_ray(b, axis);
  return ground_a && ground_b ? distance_m(*ground_a, *ground_b) : distance_m(a.position, b.position);
}

std::array<double, LookFeatures::kCount + 2> evidence(const LookFeatures& features, const LookLikelihoodTable& table) {
  std::array<double, LookFeatures::kCount + 2> summands{};
  const auto values = features.values();
  for (std::size_t i = 0; i < values.size(); ++i) summands[i] = table.curves[i](values[i]);
  summands[LookFeatures::kCount] =
      std::max(0.0, features.ln_places - table.reference_ln_places) * table.ratio_by_places(features.ratio);
  summands[LookFeatures::kCount + 1] = table.constant;
  return summands;
}

}  // namespace

double attitude_deviation_sigmas(const SolvedPose& solved, const AnchorPrior& prior) {
  using namespace parameters::anchor_measurement;
  const Attitude& found = solved.pose.attitude;
  const Attitude& predicted = prior.search.pose.attitude;
  const Eigen::Vector2d tilt(found.pitch_rad - predicted.pitch_rad, found.roll_rad - predicted.roll_rad);
  const Eigen::Matrix2d tilt_spread =
      prior.tilt_covariance_rad2 + kTiltModelError_rad * kTiltModelError_rad * Eigen::Matrix2d::Identity();
  const double tilt_sigmas = std::sqrt(tilt.dot(tilt_spread.inverse() * tilt) / 2);
  const double height_sigmas = std::abs(std::log(solved.pose.agl_m / prior.search.pose.agl_m)) /
                               hypotenuse(prior.log_agl_sigma, kHeightModelError);
  return std::max(tilt_sigmas, height_sigmas);
}

LookFeatures features_of(const AnchorMatch& match, const AnchorPrior& prior, double searched_area_m2) {
  if (!match.solved || match.search.places.empty()) {
    throw Error({.what = "a match without a solved pose has no features", .fix = "ask for match.solved first"});
  }
  const SolvedPose& solved = *match.solved;
  LookFeatures features;
  features.ratio = match.search.ratio;
  features.score = match.search.places.front().score;
  features.inlier_share = static_cast<double>(solved.inliers) / std::max(1, match.patches);
  features.inliers = solved.inliers;
  features.residual_px = solved.rms_m / match.fine_gsd_m;
  features.frame_share = match.frame_share;
  features.shift_px = axis_shift_m(match.search.places.front().pose, solved.pose) / match.coarse_gsd_m;
  features.deviation_sigmas = attitude_deviation_sigmas(solved, prior);
  features.tilt_sigma_rad = std::sqrt(prior.tilt_covariance_rad2.trace() / 2);
  features.ln_poses = std::log(poses_tried(prior.search));
  features.ln_places = std::log(distinct_places(match, searched_area_m2));
  return features;
}

double MonotoneCurve::operator()(double x) const {
  if (knots == 0) return 0;
  const auto last = static_cast<std::size_t>(knots) - 1;
  // Not a number is no evidence: it falls to the first or last knot, whichever says less.
  if (std::isnan(x)) return std::min(value[0], value[last]);
  if (x <= at[0]) return value[0];
  for (std::size_t i = 1; i <= last; ++i) {
    if (x <= at[i]) return std::lerp(value[i - 1], value[i], (x - at[i - 1]) / (at[i] - at[i - 1]));
  }
  return value[last];
}

double log_likelihood_ratio(const LookFeatures& features, const LookLikelihoodTable& table) {
  const auto summands = evidence(features, table);
  return std::clamp(std::accumulate(summands.begin(), summands.end(), 0.0), -table.limit, table.limit);
}

double log_likelihood_ratio(const LookFeatures& features) {
  return log_likelihood_ratio(features, kLookLikelihoodTable);
}

double log_likelihood_ratio(const AnchorMatch& match, const AnchorPrior& prior, double searched_area_m2) {
  if (match.judged_log_likelihood_ratio) return *match.judged_log_likelihood_ratio;
  return log_likelihood_ratio(features_of(match, prior, searched_area_m2));
}

std::array<double, LookFeatures::kCount + 2> evidence_by_feature(const LookFeatures& features) {
  return evidence(features, kLookLikelihoodTable);
}

const LookLikelihoodTable& look_likelihood_table() { return kLookLikelihoodTable; }

}  // namespace nadir
