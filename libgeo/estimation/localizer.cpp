#include "estimation/localizer.hpp"

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>

#include "estimation/anchor_job.hpp"
#include "estimation/localizer_state.hpp"
#include "estimation/plausible_telemetry.hpp"
#include "estimation/sloping_ground.hpp"
#include "geodesy/angles.hpp"
#include "vision/frame_quality.hpp"

namespace nadir {
namespace {

constexpr double kLeastLostSigma_m = 1000;
constexpr double kUntoldHeightSigma = 0.3;       // of its logarithm
constexpr double kSharedModelError_rad = 0.015;  // 1.5 % of the height
constexpr double kSurelyShared = 0.5;            // of a picture's longer side: so much shorter a way leaves an overlap
constexpr double kFastestSigmas = 4.5, kGusts_mps = 5;
constexpr double kSightSlack = 0.1;  // of a picture's longer side: what a tilt feigns
constexpr double kContradictedTurn_rad = 0.5, kTurnSigmas = 5;
constexpr double kVagueHeading_rad = 0.5;

}  // namespace

double map_sigma_from_ce90(double ce90_m) { return ce90_m / 2.146; }  // sqrt(-2 ln(1 - 0.9))

Localizer::Localizer(const CameraFile& camera, const LocalFrame& frame, const TileSource* tiles,
                     std::optional<LonLat> start, const LocalizerConfig& config)
    : state_(std::make_unique<State>(camera, frame, tiles, start, config)) {}

Localizer::~Localizer() = default;

FrameReport Localizer::process(const cv::Mat& image, const Telemetry& told) {
  Followed followed = follow(image, told);
  if (!followed.job) return followed.report;
  followed.job->run();
  FrameReport report = finish(std::move(followed.job));
  report.odometry = followed.report.odometry;
  return report;
}

Localizer::Followed Localizer::follow(const cv::Mat& image, const Telemetry& told) {
  State& s = *state_;
  const Telemetry telemetry = plausible_telemetry(told, s.last_time_s.value_or(0));
  Followed followed;
  FrameReport& report = followed.report;
  cv::Mat grey = image;
  if (image.channels() == 3) cv::cvtColor(image, grey, cv::COLOR_BGR2GRAY);

  const bool usable = judge_frame(grey).usable && !s.frozen.again(grey);
  const double seconds = s.last_time_s ? telemetry.time_s - *s.last_time_s : 0;
  s.tilt_logged = s.tilt_logged || told.pitch_rad.has_value();  // a NaN as well: of a source that tells it otherwise
  s.begin_frame(telemetry, seconds);
  const bool continues = s.continues(seconds);
  // Two pictures tell little of a motion when one may be tilted by 20 degrees.
  const bool comparable = usable && !s.flight->tilt_missing();
  if (comparable) {
    report.odometry.tracked = s.follow(grey, telemetry, report.odometry);
  } else {
    s.odometry->reset();
  }
  if (!report.odometry.tracked) s.break_track();
  s.torn = comparable && continues && !report.odometry.tracked;
  s.last_in_line = comparable && (report.odometry.tracked || s.log.size() == 1);
  s.last_time_s = telemetry.time_s;
  s.last_telemetry = telemetry;
  s.last_tracked = report.odometry.tracked;
  if (usable) {
    followed.job = s.anchor_job(grey, telemetry.time_s);
  } else {
    report.anchor.verdict = AnchorVerdict::frame_unfit;
  }
  report.estimate = s.tell(telemetry, false, report.odometry.tracked);
  report.belief = s.belief();
  s.told.push_back(report.estimate);
  return followed;
}

FrameReport Localizer::finish(std::unique_ptr<AnchorJob> job) {
  State& s = *state_;
  FrameReport report;
  if (job->match) report.anchor = s.judge(*job);
  const bool anchored = report.anchor.verdict == AnchorVerdict::accepted;
  if (anchored) {
    const double believed_rad = s.believed().heading_rad;
    s.take_anchor(*job, report.anchor);
    report.anchored = s.taken_pose;
    if (std::abs(wrap_pi(s.believed().heading_rad - believed_rad)) > kContradictedTurn_rad) s.forget_last_picture();
  }
  s.job_out = false;
  const bool last_frame = job->step + 1 == s.log.size();
  report.estimate = s.tell(s.last_telemetry, anchored && last_frame, s.last_tracked);
  report.belief = s.belief();
  s.told.back() = report.estimate;
  return report;
}

// It was seen with a heading so far off that no step from it is linear about what is known now.
void Localizer::State::forget_last_picture() {
  odometry->reset();
  last_in_line = false;
}

void Localizer::State::break_track() {
  held_back_m.setZero();
  votes.forget();
  broken_since_job = true;
  if (log.size() == 1) return;
  unbroken = false;
  ++segment;
}

void Localizer::State::begin_frame(const Telemetry& telemetry, double seconds) {
  const bool height_was_told = height_told;
  height_told = telemetry.agl_m.has_value();
  height_steady = height_told && height_was_told;
  if (height_told) told_agl_m = *telemetry.agl_m;
  if (told_agl_m <= 0) told_agl_m = config.assumed_agl_m;
  told_tilt_rad = {telemetry.pitch_rad.value_or(0), telemetry.roll_rad.value_or(0)};
  if (!flight) {
    const auto [position, sigma_m] = start_position();
    flight.emplace(uncertainty, tilt_logged, position, sigma_m);
    fresh = flight;
  }
  FlightStep& step = log.emplace_back();
  step.seconds = seconds;
  step.told_heading_rad = telemetry.heading_rad;
  step.tilt_told = telemetry.pitch_rad && telemetry.roll_rad;
  step.imu_dv_mps = telemetry.imu_dv_mps;
  step.told_agl_m = told_agl_m;
  step.told_tilt_rad = told_tilt_rad;
  flight->advance(step.seconds, step.told_heading_rad, step.tilt_told, step.imu_dv_mps);
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

double Localizer::State::speed_below_mps(double sigmas, double least_sigma_mps) const {
  const auto& covariance = flight->covariance();
  const double sigma_mps =
      std::sqrt(0.5 * covariance.block<2, 2>(FlightFilter::velocity_east, FlightFilter::velocity_east).trace());
  const double speed_mps = flight->state().segment<2>(FlightFilter::velocity_east).norm();
  return speed_mps + sigmas * std::max(sigma_mps, least_sigma_mps);
}

// Between two pictures of the same ground odometry hardly fails once and then goes on: rather one of them shows another
// place. Where it failed before, or the aircraft may have flown on by half a picture, that says nothing.
bool Localizer::State::continues(double seconds) const {
  return last_in_line &&
         speed_below_mps(2, 0) * std::abs(seconds) < kSurelyShared * footprint_side_m(camera, told_agl_m);
}

// No turn and no gust carries an aircraft so far: the pictures overlap, but one of them was not taken there and then.
bool Localizer::State::leaps(double step_m) const {
  const double seconds = std::abs(log.back().seconds);
  if (log.size() == 1 || seconds == 0) return false;  // a clock that stands tells no speed
  return step_m >
         speed_below_mps(kFastestSigmas, kGusts_mps) * seconds + kSightSlack * footprint_side_m(camera, told_agl_m);
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
  if (leaps(report.step_m)) return false;
  MotionSight sight = step->sight;
  add_unknown_slope(sight, slope);
  const double turn_rad = std::abs(wrap_pi(sight.seen[3]));
  const bool contradicted = turn_rad > std::max(kContradictedTurn_rad, kTurnSigmas * seen.heading_sigma_rad);
  if (contradicted) {
    log.back().contradicted_turn_rad = turn_rad;
    flight->doubt_heading(turn_rad);
  } else {
    held_back_m += flight->moved(sight);
    log.back().moved = sight;
  }
  doubt_way(report.step_m);
  return !contradicted;
}

// The pictures turned and the telemetry did not, or the other way round: one of them lies, and until an anchor tells
// the heading again the aircraft may fly the other way.
void Localizer::State::doubt_way(double step_m) {
  if (log.back().contradicted_turn_rad) other_way = true;
  if (flight->sigma(FlightFilter::heading) < kVagueHeading_rad) other_way = false;
  if (!other_way) {
    other_way_m = 0;
    return;
  }
  const double way_m = other_way_m + 2 * step_m;
  log.back().way_doubt_m = std::sqrt(way_m * way_m - other_way_m * other_way_m);
  flight->doubt_position(*log.back().way_doubt_m);
  other_way_m = way_m;
}

// What no number of anchors averages out: the map's own error, and what grows with height because no model has it
// (lens, relief, the moment of the telemetry).
Eigen::Matrix2d Localizer::State::shared_error_m2() const {
  if (tiles == nullptr) return Eigen::Matrix2d::Zero();
  const double model_m = kSharedModelError_rad * told_agl_m;
  return Eigen::Matrix2d::Identity() * (config.map_sigma_m * config.map_sigma_m + model_m * model_m);
}

Belief Localizer::State::belief() const {
  const auto& x = flight->state();
  const auto& p = flight->covariance();
  Belief belief;
  belief.velocity_mps = x.segment<2>(FlightFilter::velocity_east);
  belief.velocity_sigma_mps =
      std::sqrt(0.5 * p.block<2, 2>(FlightFilter::velocity_east, FlightFilter::velocity_east).trace());
  belief.heading_rad = x[FlightFilter::heading];
  belief.heading_sigma_rad = flight->sigma(FlightFilter::heading);
  belief.agl_m = told_agl_m * std::exp(x[FlightFilter::log_height]);
  belief.agl_sigma_m = belief.agl_m * flight->sigma(FlightFilter::log_height);
  return belief;
}

Estimate Localizer::State::tell(const Telemetry& telemetry, bool anchored, bool tracked) {
  Estimate estimate;
  estimate.frame = telemetry.frame;
  estimate.time_s = telemetry.time_s;
  estimate.segment = segment;
  if (last_anchor_s)
    estimate.anchor_age_s = std::max(telemetry.time_s - *last_anchor_s, 0.0);  // clocks may be set back
  estimate.anchor_inliers = last_anchor_inliers;
  estimate.anchor_ratio = last_anchor_ratio;
  if (!placed) return estimate;
  estimate.covariance_m2 = flight->position_covariance_m2() + held_back_m * held_back_m.transpose() +
                           contradicted_m * contradicted_m.transpose() +
                           (last_anchor_s ? shared_error_m2() : Eigen::Matrix2d(Eigen::Matrix2d::Zero()));
  estimate.sigma_m = std::sqrt(0.5 * estimate.covariance_m2.trace());
  estimate.source = anchored                                    ? SourceLabel::satellite_anchored
                    : tracked && (unbroken || tiles == nullptr) ? SourceLabel::vo_extrapolated
                                                                : SourceLabel::dead_reckoned;
  if (log.size() == 1 && !anchored) estimate.source = SourceLabel::dead_reckoned;
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
  const Eigen::Matrix2d map_error = s.last_anchor_s ? s.shared_error_m2() : Eigen::Matrix2d(Eigen::Matrix2d::Zero());
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
