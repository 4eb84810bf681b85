#include "estimation/map_look.hpp"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <vector>

#include "estimation/look_likelihood.hpp"
#include "vision/localizer_parameters.hpp"

namespace nadir {

using namespace parameters::anchor_measurement;

namespace {

AnchorVerdict verdict_of(const AnchorMatch& match, const LookContext& context, const Look& look,
                         const LookResult& result) {
  if (!match.on_map) return AnchorVerdict::no_map;
  if (match.search.places.empty()) return AnchorVerdict::ambiguous;
  if (!look.candidate) return AnchorVerdict::few_inliers;
  if (result.accepted) return AnchorVerdict::accepted;
  if (look.candidate->log_likelihood_ratio <= 0) return AnchorVerdict::ambiguous;
  if (!context.lost && result.chi2 > parameters::belief::kChi2_999) return AnchorVerdict::off_prediction;
  return AnchorVerdict::awaiting_votes;
}

// Of a match with a candidate. What another matcher says of the best place, it does not say of the second.
std::optional<LookCandidate> rival_of(const AnchorMatch& match, const LookCandidate& candidate,
                                      double log_likelihood_ratio) {
  const std::vector<MatchHypothesis>& places = match.search.places;
  if (places.size() < 2) return std::nullopt;
  const double searched_m = kRivalSigma_px * match.coarse_gsd_m;
  return LookCandidate{
      places[1].pose.position, candidate.covariance_m2 + searched_m * searched_m * Eigen::Matrix2d::Identity(),
      std::min(candidate.log_likelihood_ratio, log_likelihood_ratio) + rival_log_odds(match.search.ratio)};
}

}  // namespace

double rival_log_odds(double ratio) { return kRivalLogOdds - kRivalLogOddsPerRatio * (1 - ratio); }

double anchor_model_error_factor(bool tilt_missing) {
  return tilt_missing ? kUnknownTiltModelErrorFactor : kModelErrorFactor;
}

double wrong_consensus_sigma_px(double share, double ratio) {
  const double alike = std::clamp((ratio - kUnlikeRatio) / (kAlikeRatio - kUnlikeRatio), 0.0, 1.0);
  const double few = kFewPatches + alike * kAlikePatches;
  return kWrongConsensusSigma_px * std::clamp((few + kFewPatchesRange - share) / kFewPatchesRange, 0.0, 1.0);
}

double wrong_consensus_variance_m2(const AnchorMatch& match) {
  const double share = match.solved->inliers / static_cast<double>(match.patches);
  const double sigma_m = wrong_consensus_sigma_px(share, match.search.ratio) * match.fine_gsd_m;
  return sigma_m * sigma_m;
}

double wrong_consensus_left_m2(double variance_m2, const Eigen::Matrix2d& innovation_m2,
                               const Eigen::Vector2d& innovation_m) {
  if (variance_m2 == 0) return 0;
  const double wrong_m2 = variance_m2 / kWrongConsensusChance;
  const Eigen::Matrix2d wrong_innovation_m2 = innovation_m2 + wrong_m2 * Eigen::Matrix2d::Identity();
  const auto minus_twice_ln_density = [&](const Eigen::Matrix2d& covariance_m2) {
    return std::log(covariance_m2.determinant()) + innovation_m.dot(covariance_m2.inverse() * innovation_m);
  };
  const double right_over_wrong =
      (1 - kWrongConsensusChance) / kWrongConsensusChance *
      std::exp((minus_twice_ln_density(wrong_innovation_m2) - minus_twice_ln_density(innovation_m2)) / 2);
  return wrong_m2 / (1 + right_over_wrong);
}

Look look_of(const AnchorMatch& match, const LookContext& context) {
  Look look{context.window, std::nullopt, context.new_ground, context.continues_track};
  if (!match.on_map || !match.solved) return look;
  // Unmodelled errors differ over other ground and in a turn: the anchors behind the track had one value of them, this
  // one has another.
  const double variance_m2 = unmodelled_variance_m2(context.agl_m) + wrong_consensus_variance_m2(match);
  LookCandidate& candidate = look.candidate.emplace();
  candidate.position = match.solved->pose.position;
  candidate.covariance_m2 =
      anchor_model_error_factor(context.tilt_missing) * match.solved->covariance.topLeftCorner<2, 2>() +
      variance_m2 * Eigen::Matrix2d::Identity();
  const double ratio = log_likelihood_ratio(features_of(match, context.prior, context.window.area_m2()));
  candidate.log_likelihood_ratio = match.judged_log_likelihood_ratio.value_or(ratio);
  look.rival = rival_of(match, candidate, ratio);
  return look;
}

PoseMeasurement anchor_measurement(const AnchorMatch& match, const LookContext& context,
                                   const TelemetryReference& reference, const TrackPrediction& predicted,
                                   const std::optional<PlanePoint>& last_anchor) {
  const SolvedPose& solved = *match.solved;
  double shared = 1;
  if (last_anchor) {
    const double stretch_m = kSharedErrorFootprints * context.footprint_m;
    shared = std::max(1.0, stretch_m / std::max(1.0, (solved.pose.position - *last_anchor).norm()));
  }
  PoseMeasurement measurement = pose_measurement(solved, reference);
  measurement.covariance *= anchor_model_error_factor(context.tilt_missing) * shared;
  const Eigen::Matrix2d innovation_m2 = predicted.covariance_m2 + measurement.covariance.topLeftCorner<2, 2>() +
                                        unmodelled_variance_m2(context.agl_m) * Eigen::Matrix2d::Identity();
  const double wrong_consensus_m2 = wrong_consensus_left_m2(wrong_consensus_variance_m2(match), innovation_m2,
                                                            solved.pose.position - predicted.position);
  measurement.covariance.topLeftCorner<2, 2>() += wrong_consensus_m2 * Eigen::Matrix2d::Identity();
  measurement.covariance(2, 2) += kMinHeightSigma * kMinHeightSigma;
  return measurement;
}

AnchorReport anchor_report(const AnchorMatch& match, const LookContext& context, const Look& look,
                           const LookResult& result) {
  AnchorReport report;
  report.verdict = verdict_of(match, context, look, result);
  report.window_radius_m = context.prior.search.radius_m;
  report.places = match.search.places;
  report.ratio = match.search.ratio;
  if (!match.search.places.empty()) report.score = match.search.places.front().score;
  report.patches = match.patches;
  report.matching_gsd_m = match.fine_gsd_m;
  report.rectified = match.rectified;
  report.matched_map = match.matched_map;
  if (!look.candidate) return report;
  report.camera = match.solved->pose.position;
  report.heading_rad = match.solved->pose.attitude.heading_rad;
  report.inliers = match.solved->inliers;
  report.residual_px = match.solved->rms_m / match.fine_gsd_m;
  report.log_likelihood_ratio = look.candidate->log_likelihood_ratio;
  report.place_doubt = result.place_doubt;
  report.chi2 = result.chi2;
  return report;
}

}  // namespace nadir
