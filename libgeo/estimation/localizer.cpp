#include "estimation/localizer.hpp"

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>

#include "estimation/attitude_belief.hpp"
#include "estimation/motion_filter.hpp"
#include "estimation/odometry.hpp"
#include "estimation/smoother.hpp"
#include "geodesy/angles.hpp"
#include "vision/frame_quality.hpp"

namespace nadir {
namespace {

// What the pose solver does not model (trees, roofs, shutter, the moment of the telemetry), as a factor on its
// variance; from the normalised errors of simulated flights.
constexpr double kAnchorModelError = 2.4;
constexpr double kSharedErrorFootprints = 1.5;
constexpr double kMostSharedAnchors = 5;
constexpr double kLowest_m = 1, kHighest_m = 30'000;  // heights that telemetry may tell
constexpr double kLargestAngle_rad = 100;             // beyond it is no angle but rubbish
constexpr double kAnchorHeadingSigma_rad = 0.01;
constexpr double kOdometryScaleFloor = 0.01;        // odometry is never trusted better than 1 % in scale …
constexpr double kOdometryHeadingFloor_rad = 0.01;  // … and this in direction

// What cannot be is unknown: an autopilot's NaN must not reach the beliefs, which would never get rid of it.
Telemetry plausible(Telemetry telemetry, double last_time_s) {
  const auto keep = [](std::optional<double>& value, double low, double high) {
    if (value && !(*value >= low && *value <= high)) value.reset();
  };
  keep(telemetry.agl_m, kLowest_m, kHighest_m);
  keep(telemetry.heading_rad, -kLargestAngle_rad, kLargestAngle_rad);
  keep(telemetry.pitch_rad, -kLargestAngle_rad, kLargestAngle_rad);
  keep(telemetry.roll_rad, -kLargestAngle_rad, kLargestAngle_rad);
  if (!std::isfinite(telemetry.time_s)) telemetry.time_s = last_time_s;
  return telemetry;
}

}  // namespace

double map_sigma_from_ce90(double ce90_m) { return ce90_m / 2.146; }  // sqrt(-2 ln(1 - 0.9))

struct Localizer::State {
  State(const CameraFile& camera_file, const LocalFrame& local_frame, const TileSource* map_tiles,
        std::optional<LonLat> start, const LocalizerConfig& localizer_config)
      : camera(camera_file.camera),
        uncertainty(camera_file.uncertainty),
        frame(local_frame),
        tiles(map_tiles),
        config(localizer_config),
        surface(config.surface != nullptr ? config.surface : &flat),
        heading(uncertainty.heading_rad),
        height(uncertainty.agl_relative),
        odometry(make_feature_odometry()) {
    if (!start) return;
    const Enu enu = frame.enu_from_lonlat(*start);
    motion.emplace(Eigen::Vector2d(enu.east_m, enu.north_m), config.start_sigma_m);
  }

  // The walk, in order.
  void believe_attitude(const Telemetry& telemetry, double seconds);
  std::optional<OdometryStep> follow(const cv::Mat& grey, const Telemetry& telemetry);
  void advance(double seconds, const std::optional<OdometryStep>& step);
  AnchorPrior anchor_prior() const;
  AnchorReport try_anchor(const cv::Mat& grey);
  double shared_error_factor(const Eigen::Vector2d& position) const;
  void take_anchor(const AnchorMatch& match, const AnchorPrior& prior);
  Estimate tell(const Telemetry& telemetry, bool anchored, bool tracked);

  void remember(const Estimate& estimate);
  CameraPose believed_pose() const;
  Eigen::Matrix2d lasting_error_m2() const;
  Eigen::Vector2d telemetry_tilt_rad(const Telemetry& telemetry) const {
    return {telemetry.pitch_rad.value_or(0), telemetry.roll_rad.value_or(0)};
  }

  CameraModel camera;
  TelemetryUncertainty uncertainty;
  LocalFrame frame;
  const TileSource* tiles;
  LocalizerConfig config;
  FlatGround flat;
  const GroundSurface* surface;

  HeadingBelief heading;
  HeightBelief height;
  std::optional<BoresightBelief> boresight;  // made with the first telemetry, which shows whether tilt is logged
  std::optional<MotionFilter> motion;
  std::unique_ptr<OdometryFrontEnd> odometry;

  double telemetry_agl_m = 0;
  Eigen::Vector2d tilt_now_rad = Eigen::Vector2d::Zero();  // telemetry's, without the boresight
  std::optional<double> last_telemetry_heading_rad;
  std::optional<double> last_time_s;
  std::optional<double> last_anchor_s;
  std::optional<Eigen::Vector2d> last_anchor_at;
  int last_anchor_inliers = 0;
  double last_anchor_ratio = 1;
  bool unbroken = false;  // odometry has tracked every frame since the last anchor or the start
  int segment = 0;
  TrackPoint point;  // of the frame in work
  std::vector<TrackPoint> track;
  std::vector<Estimate> told;
};

Localizer::Localizer(const CameraFile& camera, const LocalFrame& frame, const TileSource* tiles,
                     std::optional<LonLat> start, const LocalizerConfig& config)
    : state_(std::make_unique<State>(camera, frame, tiles, start, config)) {}

Localizer::~Localizer() = default;

FrameReport Localizer::process(const cv::Mat& image, const Telemetry& told) {
  State& s = *state_;
  const Telemetry telemetry = plausible(told, s.last_time_s.value_or(0));
  FrameReport report;
  cv::Mat grey = image;
  if (image.channels() == 3) cv::cvtColor(image, grey, cv::COLOR_BGR2GRAY);

  const bool usable = judge_frame(grey).usable;
  const double seconds = s.last_time_s ? telemetry.time_s - *s.last_time_s : 0;
  s.believe_attitude(telemetry, seconds);
  const auto step = usable ? s.follow(grey, telemetry) : std::nullopt;
  if (!usable) s.odometry->reset();
  s.advance(seconds, step);
  s.last_time_s = telemetry.time_s;
  report.odometry.tracked = step.has_value();
  if (step) {
    report.odometry.inliers = step->inliers;
    report.odometry.step_m = step->moved_m.norm();
  }
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
  report.estimate = s.tell(telemetry, anchored, step.has_value());
  return report;
}

void Localizer::State::believe_attitude(const Telemetry& telemetry, double seconds) {
  if (!boresight) boresight.emplace(uncertainty.tilt_rad, telemetry.pitch_rad.has_value());
  if (telemetry.agl_m) telemetry_agl_m = *telemetry.agl_m;
  if (telemetry_agl_m <= 0) telemetry_agl_m = config.assumed_agl_m;
  tilt_now_rad = telemetry_tilt_rad(telemetry);
  height.advance();
  boresight->advance(seconds);
}

CameraPose Localizer::State::believed_pose() const {
  CameraPose pose;
  pose.agl_m = telemetry_agl_m * height.scale();
  pose.attitude = {heading.heading_rad(), tilt_now_rad.x() + boresight->tilt_rad().x(),
                   tilt_now_rad.y() + boresight->tilt_rad().y()};
  if (motion) pose.position = {motion->position_m().x(), motion->position_m().y()};
  return pose;
}

// Odometry works with the telemetry's heading (or the last one known) and tells the turn itself.
std::optional<OdometryStep> Localizer::State::follow(const cv::Mat& grey, const Telemetry& telemetry) {
  OdometryFrame seen;
  seen.grey = grey;
  seen.camera = camera;
  const CameraPose pose = believed_pose();
  seen.agl_m = pose.agl_m;
  seen.attitude = pose.attitude;
  const double heading_now = telemetry.heading_rad.value_or(heading.heading_rad() - heading.bias_rad());
  seen.attitude.heading_rad = heading_now + heading.bias_rad();
  seen.heading_sigma_rad = telemetry.heading_rad ? std::max(0.02, 1.5 * uncertainty.heading_rad) : 1.0;
  seen.tilt_sigma_rad = boresight->changing_sigma_rad();
  // An unknown slope of the ground tilts both pictures alike, as an unknown boresight does.
  const double slope = surface->relief_sigma_m() / footprint_side_m(camera, pose.agl_m);
  seen.boresight_covariance_rad2 = boresight->constant_covariance_rad2() + slope * slope * Eigen::Matrix2d::Identity();
  seen.relief_sigma_m = surface->relief_sigma_m();
  seen.relative_height_sigma = 0.5 * uncertainty.agl_relative;
  auto step = odometry->track(seen);
  std::optional<HeadingBelief::Turn> turn;
  const double heading_before = heading.heading_rad();
  if (step && last_telemetry_heading_rad) {
    turn = HeadingBelief::Turn{wrap_pi(step->turn_rad), step->turn_sigma_rad};
    // The step came in directions of the previous frame's assumed heading; turn it to the believed one.
    const double correction = heading_before - *last_telemetry_heading_rad;
    const double c = std::cos(correction), n = std::sin(correction);
    Eigen::Matrix2d clockwise;
    clockwise << c, n, -n, c;
    step->moved_m = clockwise * step->moved_m;
    step->covariance_m2 = clockwise * step->covariance_m2 * clockwise.transpose();
  }
  heading.advance(telemetry.heading_rad, turn);
  last_telemetry_heading_rad = seen.attitude.heading_rad;
  return step;
}

void Localizer::State::advance(double seconds, const std::optional<OdometryStep>& step) {
  if (!step) {
    unbroken = false;
    if (!told.empty()) ++segment;
  }
  if (!motion) return;
  if (step) {
    MotionFilter::Step moved;
    moved.moved_m = step->moved_m;
    moved.covariance_m2 = step->covariance_m2;
    moved.heading_sigma_rad = std::hypot(heading.sigma_rad(), kOdometryHeadingFloor_rad);
    moved.scale_sigma = std::hypot(height.sigma(), kOdometryScaleFloor);
    motion->advance(seconds, moved);
  } else {
    motion->advance(std::max(0.0, seconds));
  }
  point.predicted_m = motion->position_m();
  point.predicted_m2 = motion->covariance_m2();
}

AnchorPrior Localizer::State::anchor_prior() const {
  AnchorPrior prior;
  prior.search.pose = believed_pose();
  prior.search.radius_m = std::clamp(3 * motion->sigma_m(), config.min_search_radius_m, config.max_search_radius_m);
  prior.search.heading_range_rad = std::min(kPi, 3 * heading.sigma_rad());
  prior.search.scale_range = 2.5 * height.sigma();
  prior.heading_sigma_rad = heading.sigma_rad();
  prior.log_agl_sigma = height.sigma();
  prior.tilt_covariance_rad2 = boresight->frame_covariance_rad2();
  return prior;
}

AnchorReport Localizer::State::try_anchor(const cv::Mat& grey) {
  AnchorReport report;
  if (tiles == nullptr || !motion) return report;
  const AnchorPrior prior = anchor_prior();
  const AnchorMatch match = match_anchor(grey, camera, *tiles, frame, prior, *surface);
  report.window_radius_m = prior.search.radius_m;
  report.ratio = match.search.ratio;
  if (!match.search.places.empty()) report.score = match.search.places.front().score;
  report.patches = match.patches;
  report.matching_gsd_m = match.fine_gsd_m;
  report.rectified = match.rectified;
  report.matched_map = match.matched_map;
  Prediction prediction{0, motion->sigma_m(), unbroken};
  if (match.solved) {
    const SolvedPose& solved = *match.solved;
    report.camera = solved.pose.position;
    report.heading_rad = solved.pose.attitude.heading_rad;
    report.inliers = solved.inliers;
    report.residual_px = solved.rms_m / match.fine_gsd_m;
    const Eigen::Matrix2d covariance = solved.covariance.topLeftCorner<2, 2>();
    prediction.chi2 = motion->chi2({solved.pose.position.east_m, solved.pose.position.north_m}, covariance);
    report.chi2 = prediction.chi2;
  }
  report.verdict = judge_anchor(match, prior, prediction, config.gates);
  if (report.verdict == AnchorVerdict::accepted) take_anchor(match, prior);
  return report;
}

// Anchors over the same ground err alike (its slope and roofs, the attitude's slow error): those within a stretch count
// as one, however many frames there were.
double Localizer::State::shared_error_factor(const Eigen::Vector2d& position) const {
  if (!last_anchor_at) return 1;
  const double stretch_m = kSharedErrorFootprints * footprint_side_m(camera, telemetry_agl_m);
  return std::clamp(stretch_m / std::max(1.0, (position - *last_anchor_at).norm()), 1.0, kMostSharedAnchors);
}

void Localizer::State::take_anchor(const AnchorMatch& match, const AnchorPrior& prior) {
  const SolvedPose& solved = *match.solved;
  const Eigen::Vector2d position(solved.pose.position.east_m, solved.pose.position.north_m);
  const double shared = shared_error_factor(position);
  motion->anchor(position, kAnchorModelError * shared * solved.covariance.topLeftCorner<2, 2>());
  last_anchor_at = position;
  heading.observe(solved.pose.attitude.heading_rad, kAnchorHeadingSigma_rad);
  // The solver started from the height belief: give the belief only what the sights added.
  const double posterior = solved.covariance(2, 2), before = prior.log_agl_sigma * prior.log_agl_sigma;
  if (posterior < 0.9 * before) {
    const double gain = 1 - posterior / before;
    const double seen = std::log(solved.pose.agl_m / prior.search.pose.agl_m) / gain;
    height.observe(std::log(height.scale()) + seen, std::sqrt(posterior / gain));
  }
  boresight->observe(solved, tilt_now_rad, shared);
  unbroken = true;
}

// Errors that all anchors share, so that no number of anchors averages them out: the map's own, and what is not yet
// known of the boresight.
Eigen::Matrix2d Localizer::State::lasting_error_m2() const {
  if (tiles == nullptr) return Eigen::Matrix2d::Zero();
  const double c = std::cos(heading.heading_rad()), n = std::sin(heading.heading_rad());
  Eigen::Matrix2d ground_from_tilt;  // pitch moves the sight ahead, roll moves it to the left
  ground_from_tilt << n, -c, c, n;
  ground_from_tilt *= telemetry_agl_m * height.scale();
  const double map = config.map_sigma_m * config.map_sigma_m;
  return map * Eigen::Matrix2d::Identity() +
         ground_from_tilt * boresight->constant_covariance_rad2() * ground_from_tilt.transpose();
}

Estimate Localizer::State::tell(const Telemetry& telemetry, bool anchored, bool tracked) {
  Estimate estimate;
  estimate.frame = telemetry.frame;
  estimate.time_s = telemetry.time_s;
  estimate.segment = segment;
  if (last_anchor_s) estimate.anchor_age_s = telemetry.time_s - *last_anchor_s;
  estimate.anchor_inliers = last_anchor_inliers;
  estimate.anchor_ratio = last_anchor_ratio;
  if (motion) {
    estimate.covariance_m2 = motion->covariance_m2() + (last_anchor_s ? lasting_error_m2() : Eigen::Matrix2d::Zero());
    estimate.sigma_m = std::sqrt(0.5 * estimate.covariance_m2.trace());
    estimate.source = anchored                                    ? SourceLabel::satellite_anchored
                      : tracked && (unbroken || tiles == nullptr) ? SourceLabel::vo_extrapolated
                                                                  : SourceLabel::dead_reckoned;
    if (told.empty() && !anchored) estimate.source = SourceLabel::dead_reckoned;
    if (estimate.sigma_m > config.no_fix_sigma_m) estimate.source = SourceLabel::no_fix;
    if (estimate.source != SourceLabel::no_fix) {
      const Eigen::Vector2d at = motion->position_m();
      estimate.position = frame.lonlat_from_enu(at.x(), at.y());
    }
  }
  remember(estimate);
  return estimate;
}

void Localizer::State::remember(const Estimate& estimate) {
  if (motion) {
    point.position_m = motion->position_m();
    point.covariance_m2 = motion->covariance_m2();
    track.push_back(point);
  }
  told.push_back(estimate);
}

std::vector<Estimate> Localizer::refined() const {
  const State& s = *state_;
  std::vector<Estimate> estimates = s.told;
  if (!s.motion) return estimates;
  const std::vector<SmoothedPoint> smoothed = smooth(s.track);
  const Eigen::Matrix2d lasting = s.last_anchor_s ? s.lasting_error_m2() : Eigen::Matrix2d::Zero();
  for (std::size_t i = 0; i < estimates.size(); ++i) {
    Estimate& estimate = estimates[i];
    estimate.covariance_m2 = smoothed[i].covariance_m2 + lasting;
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
