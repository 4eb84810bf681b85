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
std::optional<LookCandidate> rival_of(const AnchorMatch& match, const LookContext& context,
                                      const LookCandidate& candidate) {
  const std::vector<MatchHypothesis>& places = match.search.places;
  if (places.size() < 2) return std::nullopt;
  const double searched_m = kRivalSigma_px * match.coarse_gsd_m;
  const LookFeatures features = features_of(match, context.prior, context.window.area_m2());
  return LookCandidate{
      places[1].pose.position, candidate.covariance_m2 + searched_m * searched_m * Eigen::Matrix2d::Identity(),
      std::min(candidate.log_likelihood_ratio, log_likelihood_ratio(features)) + rival_log_odds(features.ratio)};
}

}  // namespace

double rival_log_odds(double ratio) { return kRivalLogOdds - kRivalLogOddsPerRatio * (1 - ratio); }

double anchor_model_error_factor(bool tilt_missing) {
  return tilt_missing ? kUnknownTiltModelErrorFactor : kModelErrorFactor;
}

double unmodelled_variance_m2(double agl_m) {
  const double sigma_m = kUnmodelledShare * agl_m;
  return sigma_m * sigma_m;
}

double wrong_consensus_sigma_px(double share, double ratio) {
  return share < (ratio < kAlikeRatio ? kMostPatches : kMostPatchesAlike) ? kWrongConsensusSigma_px : 0;
}

double wrong_consensus_variance_m2(const AnchorMatch& match) {
  const double share = match.solved->inliers / static_cast<double>(match.patches);
  const double sigma_m = wrong_consensus_sigma_px(share, match.search.ratio) * match.fine_gsd_m;
  return sigma_m * sigma_m;
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
  candidate.log_likelihood_ratio = log_likelihood_ratio(match, context.prior, context.window.area_m2());
  look.rival = rival_of(match, context, candidate);
  return look;
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
  const double sigma_m = std::sqrt(context.track.covariance_m2.trace() / 2);
  report.corroborated =
      context.anchored && sigma_m <= parameters::belief::kSharp_m && result.chi2 <= parameters::belief::kChi2_95;
  return report;
}

}  // namespace nadir
