// A frame and the map: where to look, what to believe, what to take.
#include <Eigen/LU>
#include <algorithm>
#include <cmath>

#include "estimation/anchor_job.hpp"
#include "estimation/localizer_state.hpp"
#include "geodesy/angles.hpp"
#include "geodesy/web_mercator.hpp"

namespace nadir {
namespace {

// What the pose solver does not model (trees, roofs, shutter, the moment of the telemetry), as a factor on its
// variance; from the normalised errors of simulated flights.
constexpr double kAnchorModelError = 4;
// Sets of patches that agreed on a wrong pose nearby lay up to 26 px from the truth (docs/safety.md).
constexpr double kWrongConsensusSigma_px = 10;
constexpr double kTiltlessModelError = 9;  // all of that looks like a tilt, where nobody told it
constexpr double kSharedErrorFootprints = 1.5;
constexpr double kVotesApartFootprints = 0.8;  // by then a picture shows little of the first one's ground
constexpr double kLeastTiltVariance_rad2 = 1e-6;
constexpr double kLeastFound_px = 128;       // of the map, along a picture's longer side, to be looked for everywhere
constexpr double kLeastHeightSigma = 0.012;  // roofs, trees and rolling ground

double model_error(const AnchorJob& job) { return job.flight.tilt_missing() ? kTiltlessModelError : kAnchorModelError; }

}  // namespace

AnchorPrior Localizer::State::anchor_prior() const {
  AnchorPrior prior;
  const double height_sigma = std::max(kLeastHeightSigma, flight->sigma(FlightFilter::log_height));
  prior.search.pose = predicted_pose();
  prior.search.radius_m = window.radius_m(flight->position_sigma_m());
  prior.heading_sigma_rad = flight->sigma(FlightFilter::heading);
  prior.search.heading_range_rad = std::min(kPi, 3 * prior.heading_sigma_rad);
  prior.search.scale_range = 2.5 * height_sigma;
  prior.log_agl_sigma = height_sigma;
  prior.tilt_covariance_rad2 = flight->covariance().block<2, 2>(FlightFilter::pitch, FlightFilter::pitch) +
                               kLeastTiltVariance_rad2 * Eigen::Matrix2d::Identity();
  return prior;
}

bool Localizer::State::anchor_due() const {
  if (config.anchor_every_m <= 0 || !last_anchor_at || !unbroken || last_look_failed) return true;
  return flight->position_sigma_m() > config.anchor_above_sigma_m ||
         (flight->position_m() - *last_anchor_at).norm() >= config.anchor_every_m;
}

// On the ground and right after take-off a picture shows a few pixels of the map, which are everywhere: searching all
// of the area for them takes a minute, in which nothing else is looked up.
bool Localizer::State::too_low_to_be_found() const {
  const double map_gsd_m = ground_resolution_m(tiles->zooms().max, frame.origin().lat_deg);
  return lost() && footprint_side_m(camera, measured_agl_m) < kLeastFound_px * map_gsd_m;
}

std::unique_ptr<AnchorJob> Localizer::State::anchor_job(const cv::Mat& grey, double time_s) {
  if (job_out || tiles == nullptr || (!placed && !config.area) || !anchor_due() || too_low_to_be_found()) {
    return nullptr;
  }
  heed_hint();
  const AnchorPrior prior = anchor_prior();
  Prediction prediction{0, flight->position_sigma_m(), unbroken && last_anchor_s, lost(), !last_anchor_s};
  prediction.followed = last_tracked;
  prediction.torn = torn;
  std::optional<LostSearch> where;
  if (prediction.lost) where = lost_search();
  auto look = [this, grey, where, begin = prior](const Cancel& cancel) {
    AnchorPrior from = begin;
    from.cancel = cancel;
    return where ? match_lost(grey, from, *where) : matcher->match(grey, from);
  };
  const bool everywhere = where && !where->hint;
  job_out = true;
  broken_since_job = false;
  return std::make_unique<AnchorJob>(AnchorJob{std::move(look), std::nullopt, log.size() - 1, time_s, measured_agl_m,
                                               measured_tilt_rad, *flight, prior, prediction, everywhere});
}

AnchorReport Localizer::State::judge(const AnchorJob& job) {
  AnchorReport report;
  const AnchorMatch& match = *job.match;
  report.window_radius_m = job.prior.search.radius_m;
  report.ratio = match.search.ratio;
  if (!match.search.places.empty()) report.score = match.search.places.front().score;
  report.patches = match.patches;
  report.matching_gsd_m = match.fine_gsd_m;
  report.rectified = match.rectified;
  report.matched_map = match.matched_map;
  Prediction prediction = job.prediction;
  std::optional<Eigen::Vector2d> off;
  if (match.solved) {
    const SolvedPose& solved = *match.solved;
    report.camera = solved.pose.position;
    report.heading_rad = solved.pose.attitude.heading_rad;
    report.inliers = solved.inliers;
    report.residual_px = solved.rms_m / match.fine_gsd_m;
    off = Eigen::Vector2d(solved.pose.position.east_m, solved.pose.position.north_m) - job.flight.position_m();
    Eigen::Matrix2d spread =
        model_error(job) * solved.covariance.topLeftCorner<2, 2>() + job.flight.position_covariance_m2();
    // What no model has is another over other ground, and in a turn: the anchors before, which made the track, erred by
    // one, this one by another.
    if (last_anchor_s) spread += unmodelled_m2(job.measured_agl_m) * Eigen::Matrix2d::Identity();
    prediction.chi2 = off->dot(spread.inverse() * *off);
    if (!last_anchor_s && !config.resumed)
      prediction.chi2 = against_start.weighed(*off, prediction.chi2, prediction.sigma_m);
    report.chi2 = prediction.chi2;
    report.corroborated = corroborated(prediction, config.gates);
  }
  report.verdict = judge_anchor(match, job.prior, prediction, config.gates);
  confirm(report, off, job);
  window.attempted(report.verdict);
  last_look_failed = report.verdict != AnchorVerdict::accepted;
  return report;
}

// Frames that no prediction confirms confirm each other. Against an earlier anchor, several that contradict it alike
// are right in the end; against the start they are not: a map may lie, and then nothing is known for sure. Until that
// is settled the estimate owns up to both places.
void Localizer::State::confirm(AnchorReport& report, const std::optional<Eigen::Vector2d>& off_m,
                               const AnchorJob& job) {
  const bool contradicts = report.verdict == AnchorVerdict::off_prediction;
  const bool waits = report.verdict == AnchorVerdict::awaiting_votes;
  const bool off_start = !last_anchor_s && !job.prediction.lost && report.chi2 > config.gates.expected_chi2;
  if (contradicts || (waits && off_start)) {
    contradicted_m = *off_m;
    if (!last_anchor_s) against_start.remember(*off_m, report.chi2, job.prediction.sigma_m);
  }
  if (broken_since_job) return;  // a voice about a track that has ended since
  if (!contradicts && !waits) {
    votes.abstain(job.flight.position_m());
    return;
  }
  Quorum quorum;
  quorum.voices = contradicts && job.prediction.healthy ? AnchorVotes::kVoicesAgainstAnchors : AnchorVotes::kVoices;
  if (!job.prediction.lost) quorum.agree_m = AnchorVotes::agree_in_window_m(job.prior.search.radius_m);
  quorum.apart_m = kVotesApartFootprints * footprint_side_m(camera, job.measured_agl_m);
  const bool agreed = votes.vote(*off_m, job.flight.position_m(), quorum);
  if (!agreed || (contradicts && !last_anchor_s && !config.resumed)) return;
  report.verdict = AnchorVerdict::accepted;
  if (contradicts) log[job.step].position_doubt_m = off_m->norm();
}

// Anchors over the same ground err alike (its slope and roofs, the map's own warps): those within a stretch count as
// one, however many frames there were.
double Localizer::State::shared_error_factor(const Eigen::Vector2d& position, double agl_m) const {
  if (!last_anchor_at) return 1;
  const double stretch_m = kSharedErrorFootprints * footprint_side_m(camera, agl_m);
  return std::max(1.0, stretch_m / std::max(1.0, (position - *last_anchor_at).norm()));
}

// Where most patches found something else, those that agree may be the wrong ones, until a sharp prediction says the
// same.
double Localizer::State::wrong_consensus_m2(const AnchorReport& report) const {
  if (report.corroborated || report.inliers >= config.gates.most_inlier_share * report.patches) return 0;
  const double sigma_m = kWrongConsensusSigma_px * report.matching_gsd_m;
  return sigma_m * sigma_m;
}

void Localizer::State::take_anchor(const AnchorJob& job, const AnchorReport& report) {
  const SolvedPose& solved = *job.match->solved;
  const Eigen::Vector2d position(solved.pose.position.east_m, solved.pose.position.north_m);
  PoseMeasurement sight = pose_sight(solved, job.measured_agl_m, job.measured_tilt_rad);
  sight.covariance *= model_error(job) * shared_error_factor(position, job.measured_agl_m);
  sight.covariance.topLeftCorner<2, 2>() += wrong_consensus_m2(report) * Eigen::Matrix2d::Identity();
  sight.covariance(2, 2) += kLeastHeightSigma * kLeastHeightSigma;
  FlightStep& step = log[job.step];
  step.anchored = sight;
  step.anchored_clearly = job.match->search.ratio < config.gates.clear_ratio &&
                          solved.inliers >= config.gates.sure_inlier_share * job.match->patches;
  flight = job.flight;
  if (step.position_doubt_m) flight->doubt_position(*step.position_doubt_m);
  flight->anchored(sight);
  taken_pose = anchored_pose(job);
  last_anchor_s = job.time_s;
  last_anchor_at = position;
  last_anchor_inliers = solved.inliers;
  last_anchor_ratio = job.match->search.ratio;
  held_back_m.setZero();
  contradicted_m.setZero();
  against_start.forget();
  votes.forget();
  hinted.reset();
  placed = true;
  unbroken = !broken_since_job;
  follow_again(job.step + 1);
}

// The frames that were followed while the map was looked at, with what it said.
void Localizer::State::follow_again(std::size_t from) {
  for (; from < log.size(); ++from) {
    held_back_m += take_step(*flight, log[from], true);
    if (!log[from].moved) held_back_m.setZero();
  }
}

}  // namespace nadir
