#include "estimation/anchor_acceptance.hpp"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <numbers>

namespace nadir {

using namespace parameters::anchor_measurement;

// ---- Gates

namespace {

// corroborated_closely: a sharp prediction agrees, and the patches agree more closely than by chance.
double needed_inlier_share(double ratio, bool corroborated_closely, const GateLimits& limits) {
  if (ratio <= limits.clear_ratio) return limits.clear_inlier_share;
  if (ratio <= limits.alone_ratio || corroborated_closely) return limits.alone_inlier_share;
  return limits.vote_inlier_share;
}

// Where many places competed and hardly any came near, the ratio supports the place.
bool distinctive(const AnchorMatch& match, const AnchorPrior& prior, const GateLimits& limits) {
  return match.search.ratio <= limits.clear_ratio && prior.search.radius_m >= limits.telling_window_m;
}

// Few patches; or not many, which fit badly, are away from the prediction or leave the camera's tilt open.
bool chance_consensus(const AnchorMatch& match, const AnchorPrior& prior, double share,
                      const AnchorPrediction& prediction, const GateLimits& limits) {
  if (share < limits.sure_inlier_share) return true;
  const double tilt_variance_rad2 = prior.tilt_covariance_rad2.trace() / 2;
  const bool loose = match.solved->rms_m > limits.max_chance_residual_px * match.fine_gsd_m;
  const bool open = tilt_variance_rad2 > limits.open_tilt_rad * limits.open_tilt_rad;
  const bool unexpected = !prediction.lost && prediction.chi2 > limits.expected_chi2;
  return share < limits.most_inlier_share && (loose || open || unexpected);
}

// So far from the start that one frame is not sufficient evidence.
bool contradicts_start(const AnchorPrediction& prediction, const GateLimits& limits) {
  if (!prediction.before_first_anchor || prediction.lost) return false;
  return prediction.chi2 > (prediction.odometry_linked ? limits.chi2_99 : limits.expected_chi2);
}

}  // namespace

bool corroborated(const AnchorPrediction& prediction, const GateLimits& limits) {
  return prediction.healthy && prediction.sigma_m <= limits.sharp_sigma_m && prediction.chi2 <= limits.expected_chi2;
}

AnchorVerdict evaluate_anchor(const AnchorMatch& match, const AnchorPrior& prior, const AnchorPrediction& prediction,
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
  if (attitude_deviation_sigmas(solved, prior) > limits.max_tilt_sigmas) return AnchorVerdict::bad_geometry;
  if (!prediction.lost && prediction.chi2 > limits.chi2_999) return AnchorVerdict::off_prediction;
  const bool chance = !corroborated(prediction, limits) && !distinctive(match, prior, limits) &&
                      chance_consensus(match, prior, share, prediction, limits);
  const bool backed = prediction.healthy && prediction.sigma_m <= limits.healthy_sigma_m;
  const bool alone = prediction.lost ? match.search.ratio <= limits.lost_ratio && share >= limits.lost_inlier_share
                                     : match.search.ratio <= limits.alone_ratio || backed;
  const bool accepted = alone && !chance && !contradicts_start(prediction, limits) && !prediction.tracking_broken;
  return accepted ? AnchorVerdict::accepted : AnchorVerdict::awaiting_votes;
}

double anchor_model_error_factor(bool tilt_missing) {
  return tilt_missing ? kUnknownTiltModelErrorFactor : kModelErrorFactor;
}

double unmodelled_variance_m2(double agl_m) {
  const double sigma_m = kUnmodelledShare * agl_m;
  return sigma_m * sigma_m;
}

// ---- Votes

double AnchorVotes::agreement_radius_m(double window_radius_m) {
  return std::min(kAgreement_m,
                  2 * window_radius_m * std::sqrt(parameters::anchor_votes::kChanceAgreement / std::numbers::pi));
}

bool AnchorVotes::vote(const Eigen::Vector2d& offset_m, PlanePoint at, const Quorum& quorum) {
  record({at, offset_m});
  int agreeing = 0;
  double separation_m = 0;
  for (const Attempt& attempt : polled(quorum)) {
    if (!attempt.offset_m || (*attempt.offset_m - offset_m).norm() > quorum.agreement_radius_m) continue;
    ++agreeing;
    separation_m = std::max(separation_m, (attempt.at - at).norm());
  }
  return agreeing >= quorum.required_votes && separation_m >= quorum.min_separation_m;
}

// The newest attempts, at least so far apart that all required ones fit between the first and the last.
std::vector<AnchorVotes::Attempt> AnchorVotes::polled(const Quorum& quorum) const {
  const double spacing_m = quorum.min_separation_m / (quorum.required_votes + 1);
  std::vector<Attempt> polled;
  for (auto attempt = attempts_.rbegin(); attempt != attempts_.rend(); ++attempt) {
    if (!polled.empty() && (attempt->at - polled.back().at).norm() < spacing_m) continue;
    polled.push_back(*attempt);
    if (std::ssize(polled) == quorum.required_votes + parameters::anchor_votes::kSpareAttempts) break;
  }
  return polled;
}

void AnchorVotes::abstain(PlanePoint at) { record({at, std::nullopt}); }

void AnchorVotes::record(const Attempt& attempt) {
  attempts_.push_back(attempt);
  if (attempts_.size() > parameters::anchor_votes::kKeptAttempts) attempts_.pop_front();
}

// ---- Start contradictions

bool StartContradictions::Place::same(const Eigen::Vector2d& other_m, double now_sigma_m) const {
  return (other_m - offset_m).norm() <= kSamePlace_m + kDriftSigmas * std::max(0.0, now_sigma_m - sigma_m);
}

double StartContradictions::effective_chi2(const Eigen::Vector2d& offset_m, double chi2, double sigma_m) const {
  for (const Place& place : places_) {
    if (place.same(offset_m, sigma_m)) chi2 = std::max(chi2, place.chi2);
  }
  return chi2;
}

void StartContradictions::record(const Eigen::Vector2d& offset_m, double chi2, double sigma_m) {
  const Place now{offset_m, effective_chi2(offset_m, chi2, sigma_m), sigma_m};
  std::erase_if(places_, [&](const Place& place) { return place.same(offset_m, sigma_m); });
  // The least recently confirmed one is dropped.
  if (places_.size() == parameters::start_contradictions::kMaxPlaces) places_.erase(places_.begin());
  places_.push_back(now);
}

// ---- All of it

AnchorDecision AnchorAcceptance::decide(const AnchorMatch& match, const AnchorContext& context, bool anchored_before,
                                        bool same_track) {
  AnchorDecision decision;
  AnchorReport& report = decision.report;
  report.window_radius_m = context.prior.search.radius_m;
  report.ratio = match.search.ratio;
  if (!match.search.places.empty()) report.score = match.search.places.front().score;
  report.patches = match.patches;
  report.matching_gsd_m = match.fine_gsd_m;
  report.rectified = match.rectified;
  report.matched_map = match.matched_map;
  AnchorPrediction prediction = context.prediction;
  std::optional<Eigen::Vector2d> offset_m;
  if (match.solved) {
    const SolvedPose& solved = *match.solved;
    report.camera = solved.pose.position;
    report.heading_rad = solved.pose.attitude.heading_rad;
    report.inliers = solved.inliers;
    report.residual_px = solved.rms_m / match.fine_gsd_m;
    offset_m = solved.pose.position - context.position;
    Eigen::Matrix2d spread = anchor_model_error_factor(context.tilt_missing) * solved.covariance.topLeftCorner<2, 2>() +
                             context.position_covariance_m2;
    // Unmodelled errors differ over other ground and in a turn: the anchors behind the track had one value of them,
    // this one has another.
    if (anchored_before) spread += unmodelled_variance_m2(context.measured_agl_m) * Eigen::Matrix2d::Identity();
    prediction.chi2 = offset_m->dot(spread.inverse() * *offset_m);
    if (!anchored_before && !start_may_be_overruled_) {
      prediction.chi2 = start_.effective_chi2(*offset_m, prediction.chi2, prediction.sigma_m);
    }
    report.chi2 = prediction.chi2;
    report.corroborated = corroborated(prediction, limits_);
  }
  report.verdict = evaluate_anchor(match, context.prior, prediction, limits_);

  const bool contradicts = report.verdict == AnchorVerdict::off_prediction;
  const bool waits = report.verdict == AnchorVerdict::awaiting_votes;
  const bool off_start = !anchored_before && !context.prediction.lost && report.chi2 > limits_.expected_chi2;
  if (contradicts || (waits && off_start)) {
    decision.contradiction_m = *offset_m;
    if (!anchored_before) start_.record(*offset_m, report.chi2, context.prediction.sigma_m);
  }
  if (!same_track) return decision;
  if (contradicts || waits) {
    count_votes(decision, *offset_m, context, anchored_before);
  } else {
    votes_.abstain(context.position);
  }
  return decision;
}

// Frames without support by a prediction support each other. Against an earlier anchor, several that contradict it
// alike are right in the end; against the start they are not: the map may be wrong, and then nothing is certain.
void AnchorAcceptance::count_votes(AnchorDecision& decision, const Eigen::Vector2d& offset_m,
                                   const AnchorContext& context, bool anchored_before) {
  const bool contradicts = decision.report.verdict == AnchorVerdict::off_prediction;
  Quorum quorum;
  if (contradicts && context.prediction.healthy) quorum.required_votes = AnchorVotes::kVotesAgainstAnchors;
  if (!context.prediction.lost) {
    quorum.agreement_radius_m = AnchorVotes::agreement_radius_m(context.prior.search.radius_m);
  }
  quorum.min_separation_m = parameters::anchor_votes::kSeparationFootprints * context.footprint_m;
  const bool agreed = votes_.vote(offset_m, context.position, quorum);
  if (!agreed || (contradicts && !anchored_before && !start_may_be_overruled_)) return;
  decision.report.verdict = AnchorVerdict::accepted;
  if (contradicts) decision.inflate_position_m = offset_m.norm();
}

}  // namespace nadir
