// A frame and the map: where to look, what to believe, what to take.
#include <Eigen/LU>
#include <algorithm>
#include <cmath>

#include "estimation/localizer_state.hpp"
#include "geodesy/angles.hpp"

namespace nadir {
namespace {

// What the pose solver does not model (trees, roofs, shutter, the moment of the telemetry), as a factor on its
// variance; from the normalised errors of simulated flights.
constexpr double kAnchorModelError = 4;
constexpr double kSharedErrorFootprints = 1.5;
constexpr double kMostSharedAnchors = 5;
constexpr double kLeastTiltVariance_rad2 = 1e-6;
constexpr double kLeastHeightSigma = 0.012;  // roofs, trees and rolling ground

}  // namespace

AnchorPrior Localizer::State::anchor_prior() const {
  AnchorPrior prior;
  const double height_sigma = std::max(kLeastHeightSigma, flight->sigma(FlightFilter::log_height));
  prior.search.pose = believed_pose();
  prior.search.radius_m = window.radius_m(flight->position_sigma_m());
  prior.heading_sigma_rad = flight->sigma(FlightFilter::heading);
  prior.search.heading_range_rad = std::min(kPi, 3 * prior.heading_sigma_rad);
  prior.search.scale_range = 2.5 * height_sigma;
  prior.log_agl_sigma = height_sigma;
  prior.tilt_covariance_rad2 = flight->covariance().block<2, 2>(FlightFilter::pitch, FlightFilter::pitch) +
                               kLeastTiltVariance_rad2 * Eigen::Matrix2d::Identity();
  return prior;
}

AnchorMatch Localizer::State::match(const cv::Mat& grey, const AnchorPrior& prior) const {
  if (!lost()) return match_anchor(grey, camera, *tiles, frame, prior, *surface);
  return match_anchor_anywhere(grey, camera, *tiles, frame, prior,
                               window.area_left(placed, flight->position_m(), flight->position_sigma_m()), *surface);
}

AnchorReport Localizer::State::try_anchor(const cv::Mat& grey) {
  AnchorReport report;
  if (tiles == nullptr || (!placed && !config.area)) return report;
  const AnchorPrior prior = anchor_prior();
  const AnchorMatch match = this->match(grey, prior);
  report.window_radius_m = prior.search.radius_m;
  report.ratio = match.search.ratio;
  if (!match.search.places.empty()) report.score = match.search.places.front().score;
  report.patches = match.patches;
  report.matching_gsd_m = match.fine_gsd_m;
  report.rectified = match.rectified;
  report.matched_map = match.matched_map;
  Prediction prediction{0, flight->position_sigma_m(), unbroken && last_anchor_s, lost()};
  std::optional<Eigen::Vector2d> off;
  if (match.solved) {
    const SolvedPose& solved = *match.solved;
    report.camera = solved.pose.position;
    report.heading_rad = solved.pose.attitude.heading_rad;
    report.inliers = solved.inliers;
    report.residual_px = solved.rms_m / match.fine_gsd_m;
    off = Eigen::Vector2d(solved.pose.position.east_m, solved.pose.position.north_m) - flight->position_m();
    const Eigen::Matrix2d spread =
        kAnchorModelError * solved.covariance.topLeftCorner<2, 2>() + flight->position_covariance_m2();
    prediction.chi2 = off->dot(spread.inverse() * *off);
    report.chi2 = prediction.chi2;
  }
  report.verdict = judge_anchor(match, prior, prediction, config.gates);
  confirm(report, off);
  window.attempted(report.verdict);
  if (report.verdict == AnchorVerdict::accepted) take_anchor(match);
  return report;
}

// Frames that no prediction confirms confirm each other. Against an earlier anchor, several that contradict it alike
// are right in the end; against the start they are not: a map may lie, and then nothing is known for sure. Until that
// is settled the estimate owns up to both places.
void Localizer::State::confirm(AnchorReport& report, const std::optional<Eigen::Vector2d>& off_m) {
  const bool contradicts = report.verdict == AnchorVerdict::off_prediction;
  if (!contradicts && report.verdict != AnchorVerdict::awaiting_votes) {
    votes.abstain();
    return;
  }
  const bool track_has_anchor = unbroken && last_anchor_s;
  const bool agreed =
      votes.vote(*off_m, contradicts && track_has_anchor ? AnchorVotes::kNeededAgainstAnchors : AnchorVotes::kNeeded);
  if (contradicts) contradicted_m = *off_m;
  if (!agreed || (contradicts && !last_anchor_s)) return;
  report.verdict = AnchorVerdict::accepted;
  if (!contradicts) return;
  log.back().position_doubt_m = off_m->norm();
  flight->doubt_position(off_m->norm());
}

// Anchors over the same ground err alike (its slope and roofs, the map's own warps): those within a stretch count as
// one, however many frames there were.
double Localizer::State::shared_error_factor(const Eigen::Vector2d& position) const {
  if (!last_anchor_at) return 1;
  const double stretch_m = kSharedErrorFootprints * footprint_side_m(camera, told_agl_m);
  return std::clamp(stretch_m / std::max(1.0, (position - *last_anchor_at).norm()), 1.0, kMostSharedAnchors);
}

void Localizer::State::take_anchor(const AnchorMatch& match) {
  const SolvedPose& solved = *match.solved;
  const Eigen::Vector2d position(solved.pose.position.east_m, solved.pose.position.north_m);
  PoseSight sight = pose_sight(solved, told_agl_m, told_tilt_rad);
  sight.covariance *= kAnchorModelError * shared_error_factor(position);
  sight.covariance(2, 2) += kLeastHeightSigma * kLeastHeightSigma;
  flight->anchored(sight);
  log.back().anchored = sight;
  last_anchor_at = position;
  held_back_m.setZero();
  contradicted_m.setZero();
  votes.forget();
  placed = true;
  unbroken = true;
}

}  // namespace nadir
