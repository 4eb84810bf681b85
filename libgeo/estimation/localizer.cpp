#include "estimation/localizer.hpp"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>

#include "estimation/anchor_votes.hpp"
#include "estimation/anchor_window.hpp"
#include "estimation/flight_filter.hpp"
#include "estimation/flight_log.hpp"
#include "estimation/odometry.hpp"
#include "estimation/plausible_telemetry.hpp"
#include "estimation/sloping_ground.hpp"
#include "geodesy/angles.hpp"
#include "vision/frame_quality.hpp"

namespace nadir {
namespace {

// What the pose solver does not model (trees, roofs, shutter, the moment of the telemetry), as a factor on its
// variance; from the normalised errors of simulated flights.
constexpr double kAnchorModelError = 4;
constexpr double kSharedErrorFootprints = 1.5;
constexpr double kMostSharedAnchors = 5;
constexpr double kLeastTiltVariance_rad2 = 1e-6;
constexpr double kLeastLostSigma_m = 1000;
constexpr double kUntoldHeightSigma = 0.3;   // of its logarithm
constexpr double kLeastHeightSigma = 0.012;  // roofs, trees and rolling ground

}  // namespace

double map_sigma_from_ce90(double ce90_m) { return ce90_m / 2.146; }  // sqrt(-2 ln(1 - 0.9))

struct Localizer::State {
  State(const CameraFile& camera_file, const LocalFrame& local_frame, const TileSource* map_tiles,
        std::optional<LonLat> known_start, const LocalizerConfig& localizer_config)
      : camera(camera_file.camera),
        uncertainty(camera_file.uncertainty),
        frame(local_frame),
        tiles(map_tiles),
        start(known_start),
        config(localizer_config),
        placed(known_start.has_value()),
        surface(config.surface != nullptr ? config.surface : &flat),
        odometry(make_feature_odometry()),
        window(localizer_config),
        unbroken(known_start.has_value()) {}

  // The walk, in order.
  void begin_frame(const Telemetry& telemetry, double seconds);
  bool follow(const cv::Mat& grey, const Telemetry& telemetry, OdometryReport& report);
  std::pair<Eigen::Vector2d, double> start_position() const;
  AnchorPrior anchor_prior() const;
  bool lost() const { return window.lost(placed, flight->position_sigma_m()); }
  AnchorMatch match(const cv::Mat& grey, const AnchorPrior& prior) const;
  AnchorReport try_anchor(const cv::Mat& grey);
  double shared_error_factor(const Eigen::Vector2d& position) const;
  void take_anchor(const AnchorMatch& match);
  Estimate tell(const Telemetry& telemetry, bool anchored, bool tracked);

  Believed believed() const;
  CameraPose believed_pose() const;
  Eigen::Matrix2d map_error_m2() const {
    return Eigen::Matrix2d::Identity() * (tiles == nullptr ? 0 : config.map_sigma_m * config.map_sigma_m);
  }

  CameraModel camera;
  TelemetryUncertainty uncertainty;
  LocalFrame frame;
  const TileSource* tiles;
  std::optional<LonLat> start;
  LocalizerConfig config;
  bool placed;  // the start is known, or an anchor has been found since
  FlatGround flat;
  const GroundSurface* surface;

  std::optional<FlightFilter> flight;  // made with the first telemetry, which shows whether tilt is logged
  std::optional<FlightFilter> fresh;   // the same before the first frame
  std::vector<FlightStep> log;
  std::unique_ptr<OdometryFrontEnd> odometry;

  double told_agl_m = 0;
  bool height_told = false;    // in this frame; else the last one told, or a guess, stands for it
  bool height_steady = false;  // in this frame and in the one before
  Eigen::Vector2d told_tilt_rad = Eigen::Vector2d::Zero();  // pitch, roll
  std::optional<double> told_heading_rad;
  std::optional<double> last_time_s;
  std::optional<double> last_anchor_s;
  std::optional<Eigen::Vector2d> last_anchor_at;
  int last_anchor_inliers = 0;
  double last_anchor_ratio = 1;
  // What steps since have taught of earlier ones. Between anchors it is not told: a track that odometry carries has no
  // jumps but those of anchors, and refined() has it all.
  Eigen::Vector2d held_back_m = Eigen::Vector2d::Zero();
  AnchorVotes votes;
  AnchorWindow window;
  bool unbroken;  // odometry has tracked every frame since the last anchor or the start
  int segment = 0;
  std::vector<Estimate> told;
};

Localizer::Localizer(const CameraFile& camera, const LocalFrame& frame, const TileSource* tiles,
                     std::optional<LonLat> start, const LocalizerConfig& config)
    : state_(std::make_unique<State>(camera, frame, tiles, start, config)) {}

Localizer::~Localizer() = default;

FrameReport Localizer::process(const cv::Mat& image, const Telemetry& told) {
  State& s = *state_;
  const Telemetry telemetry = plausible_telemetry(told, s.last_time_s.value_or(0));
  FrameReport report;
  cv::Mat grey = image;
  if (image.channels() == 3) cv::cvtColor(image, grey, cv::COLOR_BGR2GRAY);

  const bool usable = judge_frame(grey).usable;
  const double seconds = s.last_time_s ? telemetry.time_s - *s.last_time_s : 0;
  s.begin_frame(telemetry, seconds);
  if (usable) {
    report.odometry.tracked = s.follow(grey, telemetry, report.odometry);
  } else {
    s.odometry->reset();
  }
  if (!report.odometry.tracked) {
    s.held_back_m.setZero();
    s.votes.forget();
    if (!s.told.empty()) {
      s.unbroken = false;
      ++s.segment;
    }
  }
  s.last_time_s = telemetry.time_s;
  if (usable) {
    report.anchor = s.try_anchor(grey);
  } else {
    report.anchor.verdict = AnchorVerdict::frame_unfit;
  }
  const bool anchored = report.anchor.verdict == AnchorVerdict::accepted;
  if (anchored) {
    s.last_anchor_s = telemetry.time_s;
    s.last_anchor_inliers = report.anchor.inliers;
    s.last_anchor_ratio = report.anchor.ratio;
  }
  report.estimate = s.tell(telemetry, anchored, report.odometry.tracked);
  s.told.push_back(report.estimate);
  return report;
}

void Localizer::State::begin_frame(const Telemetry& telemetry, double seconds) {
  const bool height_was_told = height_told;
  height_told = telemetry.agl_m.has_value();
  height_steady = height_told && height_was_told;
  if (height_told) told_agl_m = *telemetry.agl_m;
  if (told_agl_m <= 0) told_agl_m = config.assumed_agl_m;
  told_tilt_rad = {telemetry.pitch_rad.value_or(0), telemetry.roll_rad.value_or(0)};
  told_heading_rad = telemetry.heading_rad;
  if (!flight) {
    const auto [position, sigma_m] = start_position();
    flight.emplace(uncertainty, telemetry.pitch_rad.has_value(), position, sigma_m);
    fresh = flight;
  }
  flight->advance(seconds, telemetry.heading_rad);
  FlightStep& step = log.emplace_back();
  step.seconds = seconds;
  step.told_heading_rad = telemetry.heading_rad;
  if (height_steady) return;
  step.height_doubt = height_told ? uncertainty.agl_relative : kUntoldHeightSigma;
  flight->doubt_height(*step.height_doubt);
}

// Without a start: anywhere in the area.
std::pair<Eigen::Vector2d, double> Localizer::State::start_position() const {
  if (start) {
    const Enu at = frame.enu_from_lonlat(*start);
    return {{at.east_m, at.north_m}, config.start_sigma_m};
  }
  const PlaneBox box = config.area.value_or(PlaneBox{});
  return {{(box.west_m + box.east_m) / 2, (box.south_m + box.north_m) / 2},
          std::max({kLeastLostSigma_m, box.east_m - box.west_m, box.north_m - box.south_m})};
}

Believed Localizer::State::believed() const {
  const auto& x = flight->state();
  return {x[FlightFilter::log_height], x[FlightFilter::heading], x[FlightFilter::pitch], x[FlightFilter::roll]};
}

CameraPose Localizer::State::believed_pose() const {
  const Believed belief = believed();
  CameraPose pose;
  pose.agl_m = told_agl_m * std::exp(belief.log_height);
  pose.attitude = {belief.heading_rad, told_tilt_rad.x() + belief.pitch_rad, told_tilt_rad.y() + belief.roll_rad};
  pose.position = {flight->position_m().x(), flight->position_m().y()};
  return pose;
}

bool Localizer::State::follow(const cv::Mat& grey, const Telemetry& telemetry, OdometryReport& report) {
  OdometryFrame seen;
  seen.grey = grey;
  seen.camera = camera;
  seen.believed = believed();
  const CameraPose pose = believed_pose();
  seen.agl_m = pose.agl_m;
  seen.attitude = pose.attitude;
  seen.heading_sigma_rad = telemetry.heading_rad ? std::max(0.02, 1.5 * uncertainty.heading_rad) : 1.0;
  seen.tilt_sigma_rad = flight->changing_tilt_sigma_rad();
  // An unknown slope of the ground tilts both pictures alike, as an unknown boresight does.
  const double slope = surface->relief_sigma_m() / footprint_side_m(camera, pose.agl_m);
  seen.boresight_covariance_rad2 =
      flight->covariance().block<2, 2>(FlightFilter::pitch_bias, FlightFilter::pitch_bias) +
      slope * slope * Eigen::Matrix2d::Identity();
  seen.ground_slope = ground_slope(*surface, pose.position, footprint_side_m(camera, pose.agl_m) / 3);
  seen.relief_sigma_m = surface->relief_sigma_m();
  seen.relative_height_sigma = height_steady ? 0.5 * uncertainty.agl_relative : kUntoldHeightSigma;
  const auto step = odometry->track(seen);
  if (!step) return false;
  report.inliers = step->inliers;
  report.step_m = step->moved_m.norm();
  MotionSight sight = step->sight;
  add_unknown_slope(sight, slope);
  held_back_m += flight->moved(sight);
  log.back().moved = sight;
  return true;
}

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
  Prediction prediction{0, flight->position_sigma_m(), unbroken, lost()};
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
  // Against a prediction that several frames contradict alike, it is the prediction that is wrong.
  const bool off_prediction = report.verdict == AnchorVerdict::off_prediction;
  if (report.verdict == AnchorVerdict::awaiting_votes || off_prediction) {
    if (votes.vote(*off)) report.verdict = AnchorVerdict::accepted;
    if (off_prediction && report.verdict == AnchorVerdict::accepted) {
      log.back().position_doubt_m = off->norm();
      flight->doubt_position(off->norm());
    }
  } else {
    votes.abstain();
  }
  window.attempted(report.verdict);
  if (report.verdict == AnchorVerdict::accepted) take_anchor(match);
  return report;
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
  votes.forget();
  placed = true;
  unbroken = true;
}

Estimate Localizer::State::tell(const Telemetry& telemetry, bool anchored, bool tracked) {
  Estimate estimate;
  estimate.frame = telemetry.frame;
  estimate.time_s = telemetry.time_s;
  estimate.segment = segment;
  if (last_anchor_s) estimate.anchor_age_s = telemetry.time_s - *last_anchor_s;
  estimate.anchor_inliers = last_anchor_inliers;
  estimate.anchor_ratio = last_anchor_ratio;
  if (!placed) return estimate;
  estimate.covariance_m2 = flight->position_covariance_m2() + held_back_m * held_back_m.transpose() +
                           (last_anchor_s ? map_error_m2() : Eigen::Matrix2d(Eigen::Matrix2d::Zero()));
  estimate.sigma_m = std::sqrt(0.5 * estimate.covariance_m2.trace());
  estimate.source = anchored                                    ? SourceLabel::satellite_anchored
                    : tracked && (unbroken || tiles == nullptr) ? SourceLabel::vo_extrapolated
                                                                : SourceLabel::dead_reckoned;
  if (told.empty() && !anchored) estimate.source = SourceLabel::dead_reckoned;
  if (estimate.sigma_m > config.no_fix_sigma_m) estimate.source = SourceLabel::no_fix;
  if (estimate.source != SourceLabel::no_fix) {
    const Eigen::Vector2d at = flight->position_m() - held_back_m;
    estimate.position = frame.lonlat_from_enu(at.x(), at.y());
  }
  return estimate;
}

std::vector<Estimate> Localizer::refined() const {
  const State& s = *state_;
  std::vector<Estimate> estimates = s.told;
  if (!s.placed || !s.flight) return estimates;
  const auto smoothed = smooth_flight(*s.fresh, s.log).frames;
  const Eigen::Matrix2d map_error = s.last_anchor_s ? s.map_error_m2() : Eigen::Matrix2d(Eigen::Matrix2d::Zero());
  for (std::size_t i = 0; i < estimates.size(); ++i) {
    Estimate& estimate = estimates[i];
    estimate.covariance_m2 = smoothed[i].covariance_m2 + map_error;
    estimate.sigma_m = std::sqrt(0.5 * estimate.covariance_m2.trace());
    const bool known = estimate.sigma_m <= s.config.no_fix_sigma_m;
    if (!known) estimate.source = SourceLabel::no_fix;
    if (known && estimate.source == SourceLabel::no_fix) estimate.source = SourceLabel::dead_reckoned;
    estimate.position.reset();
    if (known) estimate.position = s.frame.lonlat_from_enu(smoothed[i].position_m.x(), smoothed[i].position_m.y());
  }
  return estimates;
}

}  // namespace nadir
