#include "estimation/localizer.hpp"

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>

#include "estimation/anchor_job.hpp"
#include "estimation/localizer_state.hpp"
#include "estimation/plausible_telemetry.hpp"
#include "vision/camera_frame.hpp"

namespace nadir {
namespace {

constexpr double kLeastLostSigma_m = 1000;
constexpr double kUnmodelled_rad = 0.015;  // 1.5 % of the height

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

  const bool usable = measure_frame_quality(grey).usable && !s.frozen.repeats(grey);
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
    const double heading_before_rad = s.believed().heading_rad;
    s.take_anchor(*job, report.anchor);
    s.forget_picture_if_turned(heading_before_rad);
    report.anchored = s.taken_pose;
  }
  s.job_out = false;
  const bool last_frame = job->step + 1 == s.log.size();
  report.estimate = s.tell(s.last_telemetry, anchored && last_frame, s.last_tracked);
  report.belief = s.belief();
  s.told.back() = report.estimate;
  return report;
}

void Localizer::State::begin_frame(const Telemetry& telemetry, double seconds) {
  const bool height_was_measured = height_measured;
  height_measured = telemetry.agl_m.has_value();
  height_steady = height_measured && height_was_measured;
  if (height_measured) measured_agl_m = *telemetry.agl_m;
  if (measured_agl_m <= 0) measured_agl_m = config.assumed_agl_m;
  measured_tilt_rad = {telemetry.pitch_rad.value_or(0), telemetry.roll_rad.value_or(0)};
  if (!flight) {
    const auto [position, sigma_m] = start_position();
    flight.emplace(uncertainty, tilt_logged, position, sigma_m);
    fresh = flight;
  }
  FlightStep& step = log.emplace_back();
  step.seconds = seconds;
  step.way = telemetry.way;
  step.measured_heading_rad = telemetry.heading_rad;
  step.tilt_measured = telemetry.pitch_rad && telemetry.roll_rad;
  step.imu_dv_mps = telemetry.imu_dv_mps;
  step.measured_agl_m = measured_agl_m;
  step.measured_tilt_rad = measured_tilt_rad;
  carry_to(*flight, step);
  if (height_steady) return;
  step.height_doubt = height_measured ? uncertainty.agl_relative : kUnmeasuredHeightSigma;
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

CameraPose Localizer::State::predicted_pose() const {
  const Believed belief = believed();
  CameraPose pose;
  pose.agl_m = measured_agl_m * std::exp(belief.log_height);
  pose.attitude = {belief.heading_rad, measured_tilt_rad.x() + belief.pitch_rad, measured_tilt_rad.y() + belief.roll_rad};
  pose.position = {flight->position_m().x(), flight->position_m().y()};
  return pose;
}

// What no number of anchors averages out: the map's own error, and what grows with height because no model has it
// (lens, relief, the moment of the telemetry).
Eigen::Matrix2d Localizer::State::shared_error_m2() const {
  if (tiles == nullptr) return Eigen::Matrix2d::Zero();
  return Eigen::Matrix2d::Identity() * (config.map_sigma_m * config.map_sigma_m + unmodelled_m2(measured_agl_m));
}

double Localizer::State::unmodelled_m2(double agl_m) const {
  const double sigma_m = kUnmodelled_rad * agl_m;
  return sigma_m * sigma_m;
}

StateEstimate Localizer::State::belief() const {
  const auto& x = flight->state();
  const auto& p = flight->covariance();
  StateEstimate belief;
  belief.velocity_mps = x.segment<2>(FlightFilter::velocity_east);
  belief.velocity_sigma_mps =
      std::sqrt(0.5 * p.block<2, 2>(FlightFilter::velocity_east, FlightFilter::velocity_east).trace());
  belief.heading_rad = x[FlightFilter::heading];
  belief.heading_sigma_rad = flight->sigma(FlightFilter::heading);
  belief.agl_m = measured_agl_m * std::exp(x[FlightFilter::log_height]);
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
