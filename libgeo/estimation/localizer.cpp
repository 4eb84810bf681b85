#include "estimation/localizer.hpp"

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>
#include <utility>

#include "base/error.hpp"
#include "estimation/look_likelihood.hpp"
#include "estimation/refined_flight.hpp"
#include "estimation/search_window.hpp"
#include "estimation/terrain_surface.hpp"
#include "estimation/tracking_state.hpp"
#include "geodesy/angles.hpp"
#include "geodesy/hypotenuse.hpp"
#include "geodesy/web_mercator.hpp"
#include "package/open_package.hpp"
#include "vision/matching_plan.hpp"
#include "vision/rolling_shutter.hpp"

namespace nadir {
namespace {

using namespace parameters::anchor_measurement;
using namespace parameters::belief;
using namespace parameters::localizer;
using namespace parameters::search_window;

// What the telemetry gave the filter so far.
struct TelemetryState {
  Telemetry last;
  std::optional<double> last_time_s;
  TelemetryReference reference;  // of this frame; where it measures no height, the last one, or an assumed one
  bool height_measured = false;  // in this frame
  bool height_steady = false;    // in this frame and in the one before
  bool tilt_logged = false;      // pitch and roll are measured, if not in each frame
};

struct LastAnchor {
  double time_s = 0;
  PlanePoint position;  // matched
  int inliers = 0;
  double ratio = 1;
};

// What is published beside the filter's own state.
struct PublishedTrack {
  // Corrections of the past that odometry has made since the last anchor. They are withheld: a track that odometry
  // propagates jumps only at anchors, and refined() applies them.
  Eigen::Vector2d withheld_m = Eigen::Vector2d::Zero();
  double map_sigma_m = 0;  // of the map that the track is anchored to: of the tiles of the last anchor
  std::vector<Estimate> estimates;
};

struct LastLook {
  double time_s = 0;
  int segment = 0;
  PlanePoint position;  // of the track
};

// The track as it was before a frame: where it goes on if that frame turns out to show another place.
struct TrackBefore {
  FlightFilter filter;
  Eigen::Vector2d withheld_m;
  std::optional<LastLook> last_look;
};

struct MatchState {
  bool job_out = false;  // a frame is being matched with the map
  bool last_failed = false;
  std::optional<LastLook> last;
  Eigen::Vector2d corrected_m = Eigen::Vector2d::Zero();  // of the track's past by odometry, so far
};

// Where a lost aircraft is searched: chosen with the frame, searched by its job.
struct LostSearch {
  PlaneBox area;
  std::optional<PlaneBox> hint;
  PlaneBox part;  // of the area, to be searched when suggestions fail
};

cv::Mat grey_of(const cv::Mat& image) {
  cv::Mat grey = image;
  if (image.channels() == 3) cv::cvtColor(image, grey, cv::COLOR_BGR2GRAY);
  return grey;
}

LinearizationPoint linearization_point(const FlightFilter::State& x) {
  return {x[FlightFilter::log_height], x[FlightFilter::heading], x[FlightFilter::pitch], x[FlightFilter::roll]};
}

StateEstimate state_estimate(const FlightFilter& filter, const TelemetryReference& reference) {
  const auto& x = filter.state();
  const auto& p = filter.covariance();
  StateEstimate state;
  state.velocity_mps = x.segment<2>(FlightFilter::velocity_east);
  state.velocity_sigma_mps =
      std::sqrt(0.5 * p.block<2, 2>(FlightFilter::velocity_east, FlightFilter::velocity_east).trace());
  state.heading_rad = x[FlightFilter::heading];
  state.heading_sigma_rad = filter.sigma(FlightFilter::heading);
  state.agl_m = reference.agl_m * std::exp(x[FlightFilter::log_height]);
  state.agl_sigma_m = state.agl_m * filter.sigma(FlightFilter::log_height);
  return state;
}

}  // namespace

double map_sigma_from_ce90(double ce90_m) { return ce90_m / kCe90OverSigma; }

double map_sigma_m(const CheckedTiles& tiles) {
  std::int64_t ce90_mm = 0;
  for (const Sidecar& tile : tiles.sidecars()) ce90_mm = std::max(ce90_mm, tile.ce90_mm);
  return map_sigma_from_ce90(static_cast<double>(ce90_mm) / 1000);
}

struct Localizer::Impl {
  Impl(const CameraFile& camera_file, const LocalFrame& local_frame, const TileSource* map_tiles,
       std::optional<LonLat> known_start, const LocalizerConfig& localizer_config)
      : camera(camera_file.camera),
        readout(camera_file.readout),
        on_gimbal(camera_file.on_gimbal),
        uncertainty(camera_file.uncertainty),
        frame(local_frame),
        tiles(map_tiles),
        start(known_start),
        config(localizer_config),
        surface(config.surface != nullptr ? config.surface : &flat),
        matcher(tiles != nullptr ? config.matcher({camera, *tiles, frame, *surface}) : nullptr),
        frame_checker(config.frame_checker()),
        odometry(config.odometry()),
        placed(known_start.has_value()),
        tracking(known_start.has_value()),
        belief(known_start ? kStartDoubt : 1, config.area.value_or(around_start())),
        window(config.min_search_radius_m, config.max_search_radius_m, config.area) {}

  // The steps of a frame, in order.
  double predict(const Telemetry& plausible);
  cv::Mat at_one_moment(const cv::Mat& as_read);
  cv::Mat at_one_moment_again(const cv::Mat& as_read, const cv::Mat& grey);
  bool update_with_odometry(const OdometryFrame& seen, OdometryReport& report);
  bool update_over_outlier(const OdometryFrame& seen, OdometryReport& report);
  RelativeMotionMeasurement measured_motion(const OdometryStep& motion, const OdometryFrame& seen) const;
  MotionEvidence motion_evidence(const FlightFilter& predicted, const RelativeMotionMeasurement& measurement,
                                 int inliers) const;
  void weigh_motion(MotionEvidence& evidence);
  OdometryFrame odometry_frame(const cv::Mat& grey) const;
  void on_track_broken();
  std::unique_ptr<AnchorJob> begin_match(const cv::Mat& grey);
  FramePose update_with_anchor(const AnchorJob& job, const AnchorReport& report, double association_doubt);
  Estimate estimate(bool anchored) const;

  std::pair<PlanePoint, double> start_position() const;
  PlaneBox around_start() const;  // as far as a window may reach
  bool match_due() const;
  bool too_low_to_match() const;
  void apply_hint();
  void weigh_hint(const TrackPrediction& track);
  AnchorPrior anchor_prior() const;
  std::function<bool(const AnchorMatch&, double)> settles(const LookContext& context) const;  // AnchorPrior's
  LostSearch lost_search();
  AnchorMatch match_lost(const cv::Mat& grey, const AnchorPrior& prior, const LostSearch& where) const;
  PoseMeasurement anchor_measurement(const AnchorJob& job) const;
  FramePose anchor_pose(const AnchorJob& job) const;  // with the filter at the job's frame

  std::function<double(const PlanePoint&)> detection_odds() const;  // by the matchability map
  double map_sigma_of(const AnchorMatch& match) const;
  void widen_for_another_map(LookContext& context, const AnchorMatch& match) const;
  double new_ground() const;

  double footprint_m() const { return footprint_side_m(camera, telemetry.reference.agl_m); }
  bool lost() const { return window.lost(placed, filter->position_sigma_m()); }
  Eigen::Matrix2d shared_error_m2(double map_sigma_m) const;
  FlownFlight flown() const;

  // Fixed for the flight. A job that is out uses these and what it was given, nothing else.
  CameraModel camera;
  std::optional<SensorReadout> readout;
  bool on_gimbal;
  TelemetryUncertainty uncertainty;
  LocalFrame frame;
  const TileSource* tiles;
  std::optional<LonLat> start;
  LocalizerConfig config;
  FlatGround flat;
  const GroundSurface* surface;
  std::unique_ptr<MapMatcher> matcher;  // none without a map

  std::unique_ptr<FrameChecker> frame_checker;
  std::unique_ptr<OdometryFrontEnd> odometry;

  std::optional<FlightFilter> filter;   // made with the first telemetry, which shows whether tilt is logged
  std::optional<FlightFilter> initial;  // the same before the first frame
  std::vector<FlightStep> steps;        // a frame each
  std::optional<TrackBefore> before_now, before_last;  // before the current frame, and before the one before it
  TelemetryState telemetry;
  ShutterMotion shutter_motion;  // by which the last frame's shutter was undone
  bool placed;                   // the start is known, or an anchor has been accepted since
  TrackingState tracking;
  CourseAmbiguity course;
  int inertial_contradictions = 0;  // visual motions in a row that the inertial sensor contradicts
  std::optional<LastAnchor> last_anchor;
  PlaceBelief belief;
  SearchWindow window;
  std::optional<OperatorHint> operator_hint;
  MatchState matching;
  PublishedTrack published;
};

Localizer::Localizer(const CameraFile& camera, const LocalFrame& frame, const TileSource* tiles,
                     std::optional<LonLat> start, const LocalizerConfig& config)
    : impl_(std::make_unique<Impl>(camera, frame, tiles, start, config)) {}

Localizer::~Localizer() = default;

// ---- The path of one frame (docs/localization.md)

FrameReport Localizer::process(const cv::Mat& image, const Telemetry& measured) {
  TrackedFrame tracked = track(image, measured);
  if (!tracked.job) return tracked.report;
  tracked.job->run();
  FrameReport report = finish(std::move(tracked.job));
  report.odometry = tracked.report.odometry;
  return report;
}

Localizer::TrackedFrame Localizer::track(const cv::Mat& image, const Telemetry& measured) {
  Impl& s = *impl_;
  TrackedFrame result;
  const cv::Mat as_read = grey_of(image);
  // A gimbal may look anywhere: without its attitude an image is no measurement.
  const bool aimed = !s.on_gimbal || (measured.pitch_rad && measured.roll_rad);
  const bool usable = s.frame_checker->check(as_read).usable() && aimed;
  s.telemetry.tilt_logged = s.telemetry.tilt_logged || measured.pitch_rad.has_value();  // NaN too: other frames have it

  s.before_last = std::exchange(s.before_now, std::nullopt);
  if (s.filter) s.before_now.emplace(TrackBefore{*s.filter, s.published.withheld_m, s.matching.last});
  const double seconds = s.predict(plausible_telemetry(measured, s.telemetry.last_time_s.value_or(0)));
  s.belief.propagate(seconds);
  cv::Mat grey = usable ? s.at_one_moment(as_read) : as_read;
  // Two images hardly determine a motion when one may be tilted by 20 degrees.
  FrameLink link{.first = s.steps.size() == 1, .comparable = usable && !s.filter->tilt_missing()};
  link.expected_overlap = s.tracking.expects_overlap(*s.filter, seconds, s.footprint_m());
  if (link.comparable) {
    OdometryReport& odometry = result.report.odometry;
    const OdometryFrame seen = s.odometry_frame(grey);
    link.tracked = s.update_with_odometry(seen, odometry);
    link.over_outlier = !link.tracked && s.update_over_outlier(seen, odometry);
    odometry.tracked = link.tracked || link.over_outlier;
    grey = s.at_one_moment_again(as_read, grey);
  } else {
    s.odometry->reset();
  }
  s.tracking.on_frame(link);
  if (!s.tracking.tracked()) s.on_track_broken();

  if (usable) {
    result.job = s.begin_match(grey);
  } else {
    result.report.anchor.verdict = AnchorVerdict::frame_unfit;
  }
  result.report.estimate = s.estimate(false);
  result.report.state = state_estimate(*s.filter, s.telemetry.reference);
  s.published.estimates.push_back(result.report.estimate);
  return result;
}

FrameReport Localizer::finish(std::unique_ptr<AnchorJob> job) {
  Impl& s = *impl_;
  FrameReport report;
  LookResult result;
  if (job->match) {
    s.widen_for_another_map(job->context, *job->match);
    // Where the track was then, as it is known by now.
    job->context.track.position =
        PlanePoint(job->context.track.position.vector() + s.matching.corrected_m - job->corrected_m);
    Look look = look_of(*job->match, job->context);
    if (s.config.matchability != nullptr) look.detection_odds = s.detection_odds();
    s.weigh_hint(job->context.track);  // one that came while the frame was matched
    if (job->match->on_map) result = s.belief.update(look, job->context.track);
    report.anchor = anchor_report(*job->match, job->context, look, result);
    s.window.record_attempt(report.anchor.verdict);
    s.matching.last_failed = !result.accepted;
    s.matching.last = {job->time_s, job->segment, job->context.track.position};
    if (result.contradicted) {
      s.steps[job->step].contradicted_anchor_sigma_m = (look.candidate->position - job->context.track.position).norm();
    }
  }
  const bool anchored = result.accepted;
  if (anchored) report.anchor_pose = s.update_with_anchor(*job, report.anchor, result.association_doubt);
  s.matching.job_out = false;
  report.estimate = s.estimate(anchored && job->step + 1 == s.steps.size());
  report.state = state_estimate(*s.filter, s.telemetry.reference);
  s.published.estimates.back() = report.estimate;
  return report;
}

// ---- Prediction

// Returns the seconds since the last frame.
double Localizer::Impl::predict(const Telemetry& plausible) {
  const double seconds = telemetry.last_time_s ? plausible.time_s - *telemetry.last_time_s : 0;
  telemetry.height_steady = telemetry.height_measured && plausible.agl_m;
  telemetry.height_measured = plausible.agl_m.has_value();
  TelemetryReference& reference = telemetry.reference;
  if (telemetry.height_measured) reference.agl_m = *plausible.agl_m;
  if (reference.agl_m <= 0) reference.agl_m = config.assumed_agl_m;
  reference.tilt_rad = {plausible.pitch_rad.value_or(0), plausible.roll_rad.value_or(0)};
  telemetry.last_time_s = plausible.time_s;
  telemetry.last = plausible;

  if (!filter) {
    const auto [position, sigma_m] = start_position();
    filter.emplace(uncertainty, telemetry.tilt_logged, position, sigma_m);
    filter->set_latitude(radians(frame.origin().lat_deg));
    initial = filter;
  }
  FlightStep& step = steps.emplace_back();
  step.seconds = seconds;
  step.intervals = plausible.intervals;
  step.measured_heading_rad = plausible.heading_rad;
  step.tilt_measured = plausible.pitch_rad && plausible.roll_rad;
  step.imu_dv_mps = plausible.imu_dv_mps;
  if (!on_gimbal && steps.size() > 1) {  // a gimbal turns without the sensor
    step.inertial = preintegrate_parts(plausible.inertial, plausible.time_s - seconds, plausible.time_s);
  }
  step.reference = reference;
  step.rate_rad_s = plausible.rate_rad_s.value_or(Eigen::Vector3d::Zero());
  propagate_to(*filter, step);
  if (!telemetry.height_steady) {
    step.height_reset_sigma =
        telemetry.height_measured ? uncertainty.agl_relative : parameters::tracking::kUnmeasuredHeightSigma;
    filter->reset_height(*step.height_reset_sigma);
  }
  return seconds;
}

// With a global shutter it is so already. Without an image, as when a flight is restored, the motion alone is noted.
cv::Mat Localizer::Impl::at_one_moment(const cv::Mat& as_read) {
  if (!readout) return as_read;
  const CameraPose pose = camera_pose(filter->state(), telemetry.reference);
  shutter_motion = {.attitude = pose.attitude,
                    .agl_m = pose.agl_m,
                    .velocity_mps = filter->state().segment<2>(FlightFilter::velocity_east),
                    .rate_rad_s = telemetry.last.rate_rad_s.value_or(Eigen::Vector3d::Zero())};
  return as_read.empty() ? as_read : without_rolling_shutter(as_read, camera, *readout, shutter_motion);
}

// Odometry may have found that the velocity was another: at the beginning none was known. The frame is then undone
// anew, for the map and for the next frame's odometry; grey: as it was undone first.
cv::Mat Localizer::Impl::at_one_moment_again(const cv::Mat& as_read, const cv::Mat& grey) {
  if (!readout) return grey;
  const Eigen::Vector2d found_mps = filter->state().segment<2>(FlightFilter::velocity_east);
  if ((found_mps - shutter_motion.velocity_mps).norm() * readout->duration_s < kShutterRedone_m) return grey;
  cv::Mat again = at_one_moment(as_read);
  odometry->reset();
  odometry->track(odometry_frame(again));
  return again;
}

// Without a start: anywhere in the area.
std::pair<PlanePoint, double> Localizer::Impl::start_position() const {
  if (start) return {frame.plane_from_lonlat(*start), config.start_sigma_m};
  const PlaneBox box = config.area.value_or(PlaneBox{});
  return {box.middle(), std::max({kLeastLostSigma_m, box.east_m - box.west_m, box.north_m - box.south_m})};
}

PlaneBox Localizer::Impl::around_start() const {
  return square_around(start ? frame.plane_from_lonlat(*start) : PlanePoint{}, config.max_search_radius_m);
}

// ---- Odometry

OdometryFrame Localizer::Impl::odometry_frame(const cv::Mat& grey) const {
  using namespace parameters::tracking;
  const CameraPose pose = camera_pose(filter->state(), telemetry.reference);
  const double footprint = footprint_side_m(camera, pose.agl_m);
  OdometryFrame seen;
  seen.grey = grey;
  if (readout) seen.undone = UndoneShutter{*readout, shutter_motion};
  seen.camera = camera;
  seen.linearization_point = linearization_point(filter->state());
  seen.agl_m = pose.agl_m;
  seen.attitude = pose.attitude;
  seen.heading_sigma_rad = telemetry.last.heading_rad
                               ? std::max(kMinTurnSigma_rad, kTurnSigmaShare * uncertainty.heading_rad)
                               : kUnknownTurnSigma_rad;
  if (filter->inertial())
    seen.heading_sigma_rad = std::max(parameters::inertial::kLeastTurnSigma_rad, filter->turn_sigma_rad());
  seen.tilt_sigma_rad = filter->white_tilt_sigma_rad();
  // An unknown slope of the ground tilts both images alike, as an unknown boresight does.
  const double slope = surface->relief_sigma_m() / footprint;
  seen.boresight_covariance_rad2 =
      filter->covariance().block<2, 2>(FlightFilter::pitch_bias, FlightFilter::pitch_bias) +
      slope * slope * Eigen::Matrix2d::Identity();
  seen.ground_slope = ground_slope(*surface, pose.position, footprint / kSlopeBaselineDivisor);
  seen.relief_sigma_m = surface->relief_sigma_m();
  seen.relative_height_sigma =
      telemetry.height_steady ? kSteadyHeightShare * uncertainty.agl_relative : kUnmeasuredHeightSigma;
  return seen;
}

// As the filter takes it.
RelativeMotionMeasurement Localizer::Impl::measured_motion(const OdometryStep& motion,
                                                           const OdometryFrame& seen) const {
  RelativeMotionMeasurement measurement = motion.measurement;
  inflate_unknown_slope(measurement, surface->relief_sigma_m() / footprint_side_m(camera, seen.agl_m));
  return measurement;
}

// For the belief. predicted: before the filter takes it.
MotionEvidence Localizer::Impl::motion_evidence(const FlightFilter& predicted,
                                                const RelativeMotionMeasurement& measurement, int inliers) const {
  const FlightFilter::MotionFit fit = predicted.motion_fit(measurement);
  const double shorter =
      static_cast<double>(std::min(camera.width, camera.height)) / std::max(camera.width, camera.height);
  const auto velocity = predicted.covariance().block<2, 2>(FlightFilter::velocity_east, FlightFilter::velocity_east);
  return {.spread = fit.spread,
          .chi2 = fit.chi2,
          .doubt = motion_doubt(fit, inliers, footprint_m() * footprint_m() * shorter),
          .predicted = predicted.position(),
          .covariance_m2 = predicted.position_covariance_m2(),
          .velocity_mps = predicted.state().segment<2>(FlightFilter::velocity_east),
          .velocity_variance = velocity.trace() / 2};
}

// After the filter has taken it.
void Localizer::Impl::weigh_motion(MotionEvidence& evidence) {
  evidence.velocity_mps -= filter->state().segment<2>(FlightFilter::velocity_east);
  belief.on_motion(evidence, {filter->position(), filter->position_covariance_m2()});
}

bool Localizer::Impl::update_with_odometry(const OdometryFrame& seen, OdometryReport& report) {
  const auto motion = odometry->track(seen);
  if (!motion) return false;
  report.inliers = motion->inliers;
  report.step_m = motion->displacement_m.norm();
  FlightStep& step = steps.back();
  if (exceeds_reach(*filter, report.step_m, step.seconds, footprint_m())) return false;
  const RelativeMotionMeasurement measurement = measured_motion(*motion, seen);
  if (contradicts_inertial(*filter, measurement)) {
    if (++inertial_contradictions < parameters::inertial::kRefusedInARow) return false;
    inertial_contradictions = 0;
    step.inertial_refused_sigma_m = parameters::inertial::kRefusedInARow * filter->motion_innovation_m(measurement);
    filter->refuse_inertial(*step.inertial_refused_sigma_m);
    return false;
  }
  inertial_contradictions = 0;
  if (is_chance_motion(*filter, measurement, motion->inliers)) return false;
  const double turn_rad = std::abs(wrap_pi(measurement.value[3]));
  const bool contradicted = contradicts_turn(turn_rad, seen.heading_sigma_rad);
  if (contradicted) {
    step.contradicted_turn_rad = turn_rad;
    filter->inflate_heading(turn_rad);
  } else {
    MotionEvidence evidence = motion_evidence(*filter, measurement, motion->inliers);
    const Eigen::Vector2d correction_m = filter->update_relative(measurement);
    published.withheld_m += correction_m;
    matching.corrected_m += correction_m;
    belief.on_odometry(correction_m, filter->position_covariance_m2());
    weigh_motion(evidence);
    step.relative_motion = measurement;
  }
  step.wrong_course_sigma_m = course.on_step(contradicted, filter->sigma(FlightFilter::heading), report.step_m);
  if (step.wrong_course_sigma_m) filter->inflate_position(*step.wrong_course_sigma_m);
  return !contradicted;
}

// The last frame did not continue the one before it, and this one does not continue the last. If it continues the one
// before the last, two of three show the same ground: the last one is the outlier, and the track goes on from the frame
// before it as if the last one had only brought its telemetry.
bool Localizer::Impl::update_over_outlier(const OdometryFrame& seen, OdometryReport& report) {
  FlightStep& step = steps.back();
  if (step.inertial_refused_sigma_m) return false;
  if (!tracking.broken() || !before_last || step.contradicted_turn_rad || step.height_reset_sigma) return false;
  const FlightStep& outlier = steps[steps.size() - 2];
  if (outlier.anchor || outlier.height_reset_sigma || outlier.contradicted_turn_rad || outlier.hint_sigma_m)
    return false;
  const auto motion = odometry->track_over_last();
  if (!motion) return false;
  FlightFilter bridged = before_last->filter;
  propagate_over(bridged, outlier, step);
  const double step_m = motion->displacement_m.norm();
  if (exceeds_reach(bridged, step_m, outlier.seconds + step.seconds, footprint_m())) return false;
  const RelativeMotionMeasurement measurement = measured_motion(*motion, seen);
  if (is_chance_motion(bridged, measurement, motion->inliers)) return false;
  if (contradicts_inertial(bridged, measurement)) return false;
  if (contradicts_turn(std::abs(wrap_pi(measurement.value[3])), seen.heading_sigma_rad)) return false;
  report.inliers = motion->inliers;
  report.step_m = step_m;
  MotionEvidence evidence = motion_evidence(bridged, measurement, motion->inliers);
  const Eigen::Vector2d correction_m = bridged.update_relative(measurement);
  filter = bridged;
  step.motion_over_outlier = measurement;
  published.withheld_m = before_last->withheld_m + correction_m;
  matching.corrected_m += correction_m;
  matching.last = before_last->last_look;
  belief.on_odometry(correction_m, filter->position_covariance_m2());
  weigh_motion(evidence);
  step.wrong_course_sigma_m = course.on_step(false, filter->sigma(FlightFilter::heading), step_m);
  if (step.wrong_course_sigma_m) filter->inflate_position(*step.wrong_course_sigma_m);
  return true;
}

void Localizer::Impl::on_track_broken() { published.withheld_m.setZero(); }

// ---- Matching with the map

bool Localizer::Impl::match_due() const {
  if (config.anchor_every_m <= 0 || !last_anchor || !tracking.unbroken() || matching.last_failed) return true;
  if ((filter->position() - last_anchor->position).norm() >= config.anchor_every_m) return true;
  const double certain_m =
      config.anchor_above_sigma_m * std::sqrt(-2 * kTailVarianceFactor * std::log(config.integrity_risk));
  const auto level_m =
      belief.protection_level_m(filter->position_covariance_m2(), config.integrity_risk, Eigen::Matrix2d::Zero());
  return !level_m || *level_m > certain_m;
}

// On the ground and right after take-off an image shows a few pixels of the map, which are everywhere: searching all of
// the area for them takes a minute, in which no other frame is matched.
bool Localizer::Impl::too_low_to_match() const {
  const double map_gsd_m = ground_resolution_m(tiles->zooms().max, frame.origin().lat_deg);
  return lost() && footprint_m() < kMinFootprint_px * map_gsd_m;
}

// Share of the footprint that the last look did not show, as far as is known.
double Localizer::Impl::new_ground() const {
  if (!matching.last) return 1;
  double way_m = (filter->position() - matching.last->position).norm();
  if (matching.last->segment != tracking.segment()) {  // nothing measured the way
    const auto& covariance = filter->covariance();
    const double speed_variance =
        covariance.block<2, 2>(FlightFilter::velocity_east, FlightFilter::velocity_east).trace();
    way_m = hypotenuse(way_m, std::sqrt(speed_variance) * (telemetry.last.time_s - matching.last->time_s));
  }
  return std::min(1.0, way_m / footprint_m());
}

std::unique_ptr<AnchorJob> Localizer::Impl::begin_match(const cv::Mat& grey) {
  if (matching.job_out || tiles == nullptr || (!placed && !config.area) || !match_due() || too_low_to_match()) {
    return nullptr;
  }
  apply_hint();
  LookContext context;
  context.prior = anchor_prior();
  context.lost = lost();
  context.anchored = last_anchor && tracking.unbroken();
  context.track = {.position = filter->position(),
                   .covariance_m2 = filter->position_covariance_m2(),
                   .stands = placed && (last_anchor ? context.anchored : !config.resumed)};
  context.continues_track = !tracking.broken();
  context.new_ground = new_ground();
  context.agl_m = telemetry.reference.agl_m;
  context.footprint_m = footprint_m();
  context.tilt_missing = filter->tilt_missing();
  context.window = square_around(context.prior.search.pose.position, context.prior.search.radius_m);
  std::optional<LostSearch> where;
  if (context.lost) {
    where = lost_search();
    context.window = where->area;
  }
  auto match_frame = [this, grey, where, begin = context.prior, settles = settles(context)](const Cancel& cancel) {
    AnchorPrior prior = begin;
    prior.settles = settles;
    prior.cancel = cancel;
    return where ? match_lost(grey, prior, *where) : matcher->match(grey, prior);
  };
  matching.job_out = true;
  return std::make_unique<AnchorJob>(AnchorJob{.match_frame = std::move(match_frame),
                                               .match = std::nullopt,
                                               .step = steps.size() - 1,
                                               .time_s = telemetry.last.time_s,
                                               .segment = tracking.segment(),
                                               .reference = telemetry.reference,
                                               .flight = *filter,
                                               .context = context,
                                               .corrected_m = matching.corrected_m,
                                               .searches_everywhere = where && !where->hint});
}

// The match would be accepted, and the chance that the aircraft is elsewhere be within the risk. By the belief as it
// is now: the job runs while later frames are tracked.
std::function<bool(const AnchorMatch&, double)> Localizer::Impl::settles(const LookContext& context) const {
  return [belief = belief, context, odds = config.matchability != nullptr ? detection_odds() : nullptr,
          risk = config.integrity_risk](AnchorMatch match, double log_likelihood_ratio) {
    match.judged_log_likelihood_ratio = log_likelihood_ratio;
    Look look = look_of(match, context);
    look.detection_odds = odds;
    PlaceBelief then = belief;
    const LookResult result = then.update(look, context.track);
    return result.accepted && result.place_doubt <= risk;
  };
}

AnchorPrior Localizer::Impl::anchor_prior() const {
  AnchorPrior prior;
  const double height_sigma = std::max(kMinHeightSigma, filter->sigma(FlightFilter::log_height));
  prior.search.pose = camera_pose(filter->state(), telemetry.reference);
  prior.search.radius_m = window.radius_m(filter->position_sigma_m());
  prior.heading_sigma_rad = filter->sigma(FlightFilter::heading);
  prior.search.heading_range_rad = std::min(kPi, kHeadingSigmas * prior.heading_sigma_rad);
  prior.search.scale_range = kScaleSigmas * height_sigma;
  prior.log_agl_sigma = height_sigma;
  prior.tilt_covariance_rad2 = filter->covariance().block<2, 2>(FlightFilter::pitch, FlightFilter::pitch) +
                               kMinTiltVariance_rad2 * Eigen::Matrix2d::Identity();
  return prior;
}

LostSearch Localizer::Impl::lost_search() {
  const PlanePoint position = filter->position();
  const double sigma_m = filter->position_sigma_m();
  LostSearch where{window.reachable_area(placed, position, sigma_m), std::nullopt, {}};
  if (operator_hint) where.hint = operator_hint->box(position, sigma_m, config.area);
  where.part = window.next_part(where.area, position);
  return where;
}

AnchorMatch Localizer::Impl::match_lost(const cv::Mat& grey, const AnchorPrior& prior, const LostSearch& where) const {
  const auto plausible = [&](const AnchorMatch& match) {
    return match.solved && log_likelihood_ratio(match, prior, where.area.area_m2()) >= kWorthKeeping;
  };
  const auto among = [&](const SearchSuggestions& suggested) {
    return matcher->match_among(grey, prior, where.area, suggested);
  };
  if (where.hint || config.places != nullptr) {
    AnchorMatch match = among({where.hint, config.places});
    if (plausible(match)) return match;
  }
  // The place index is right for most frames: for the others it suffices to search a part at a time.
  if (config.places != nullptr) return among({where.part, nullptr});
  return matcher->match_anywhere(grey, prior, where.area);
}

// ---- An operator's hint

void Localizer::hint(const LonLat& at, double radius_m) {
  const bool place = std::abs(at.lon_deg) <= 180 && std::abs(at.lat_deg) <= 90;  // false for NaN too
  if (!place || !(radius_m > 0) || !std::isfinite(radius_m)) {
    throw UsageError({.what = "the hint is not a valid place",
                      .expected = "longitude, latitude and a radius above 0 m",
                      .found = std::to_string(at.lon_deg) + "," + std::to_string(at.lat_deg) + " within " +
                               std::to_string(radius_m) + " m"});
  }
  impl_->operator_hint.emplace(impl_->frame.plane_from_lonlat(at), radius_m);
}

void Localizer::Impl::weigh_hint(const TrackPrediction& track) {
  if (!operator_hint || !operator_hint->begin_weighing()) return;
  belief.on_hint({operator_hint->at(), operator_hint->radius_m() / kHintSigmas}, track);
}

// A start that was given before has no more weight than a hint that is given now.
void Localizer::Impl::apply_hint() {
  if (!operator_hint || operator_hint->propagating()) return;
  const TrackPrediction track{filter->position(), filter->position_covariance_m2()};
  weigh_hint(track);
  const double off_m = (operator_hint->at() - filter->position()).norm();
  const bool anchored = tracking.unbroken() && last_anchor;
  if (placed && !anchored && off_m > operator_hint->radius_m() + kOutsideHintSigmas * filter->position_sigma_m()) {
    steps.back().hint_sigma_m = off_m;
    filter->inflate_position(off_m);
    belief.on_anchor(Eigen::Vector2d::Zero(), track.covariance_m2, filter->position_covariance_m2());
  }
  operator_hint->start_propagation(filter->position(), filter->position_sigma_m());
}

// ---- Update with an accepted anchor

// The covariance is larger than the solver's: by what the solver does not model; by what anchors over the same ground
// share (its slope and roofs, the map's own warps: those within a stretch count as one, however many frames there
// were); and, where most patches matched something else, by the chance that those which agree are the wrong ones, as
// far as the filter's prediction does not say otherwise.
PoseMeasurement Localizer::Impl::anchor_measurement(const AnchorJob& job) const {
  const SolvedPose& solved = *job.match->solved;
  double shared = 1;
  if (last_anchor) {
    const double stretch_m = kSharedErrorFootprints * job.context.footprint_m;
    shared = std::max(1.0, stretch_m / std::max(1.0, (solved.pose.position - last_anchor->position).norm()));
  }
  PoseMeasurement measurement = pose_measurement(solved, job.reference);
  measurement.covariance *= anchor_model_error_factor(job.context.tilt_missing) * shared;
  const Eigen::Matrix2d innovation_m2 = filter->position_covariance_m2() +
                                        measurement.covariance.topLeftCorner<2, 2>() +
                                        unmodelled_variance_m2(job.context.agl_m) * Eigen::Matrix2d::Identity();
  const double wrong_consensus_m2 = wrong_consensus_left_m2(wrong_consensus_variance_m2(*job.match), innovation_m2,
                                                            solved.pose.position - filter->position());
  measurement.covariance.topLeftCorner<2, 2>() += wrong_consensus_m2 * Eigen::Matrix2d::Identity();
  measurement.covariance(2, 2) += kMinHeightSigma * kMinHeightSigma;
  return measurement;
}

// Beneath the camera: cells are as large as footprints, and frames look about straight down.
std::function<double(const PlanePoint&)> Localizer::Impl::detection_odds() const {
  return [this](const PlanePoint& place) {
    switch (config.matchability->at(frame.lonlat_from_plane(place))) {
      case MatchClass::good: return kGoodDetectionOdds;
      case MatchClass::weak:
      case MatchClass::poor: return kPoorDetectionOdds;
      case MatchClass::outside: break;
    }
    return 1.0;
  };
}

// What the tiles state that the match was found on, unless the configuration sets it.
double Localizer::Impl::map_sigma_of(const AnchorMatch& match) const {
  if (config.map_sigma_m) return *config.map_sigma_m;
  return match.map_ce90_m ? map_sigma_from_ce90(*match.map_ce90_m) : kMapSigma_m;
}

// The errors of one map are common to all of its anchors and cancel between them. Those of two maps do not.
void Localizer::Impl::widen_for_another_map(LookContext& context, const AnchorMatch& match) const {
  const double theirs_m = map_sigma_of(match), ours_m = published.map_sigma_m;
  if (!last_anchor || theirs_m == ours_m) return;
  const double between_m2 = theirs_m * theirs_m + ours_m * ours_m;
  context.track.covariance_m2 += between_m2 * Eigen::Matrix2d::Identity();
}

FramePose Localizer::Impl::update_with_anchor(const AnchorJob& job, const AnchorReport& report,
                                              double association_doubt) {
  const double heading_before_rad = filter->state()[FlightFilter::heading];
  const AnchorMatch& match = *job.match;
  FlightStep& step = steps[job.step];
  step.map_sigma_m = map_sigma_of(match);
  if (last_anchor && step.map_sigma_m < published.map_sigma_m) {
    step.finer_map_sigma_m =
        std::sqrt(published.map_sigma_m * published.map_sigma_m - step.map_sigma_m * step.map_sigma_m);
  }
  published.map_sigma_m = step.map_sigma_m;
  step.anchor_unambiguous = report.log_likelihood_ratio >= kUnambiguous;
  filter = job.flight;
  if (step.contradicted_anchor_sigma_m) filter->inflate_position(*step.contradicted_anchor_sigma_m);
  if (step.finer_map_sigma_m) filter->inflate_position(*step.finer_map_sigma_m);
  step.anchor = anchor_measurement(job);
  step.anchor->covariance =
      weighted_by_association(step.anchor->covariance, association_doubt, filter->pose_covariance());
  filter->update_absolute(*step.anchor);
  const FramePose pose = anchor_pose(job);

  last_anchor = LastAnchor{job.time_s, match.solved->pose.position, match.solved->inliers, match.search.ratio};
  published.withheld_m.setZero();
  matching.last->position = filter->position();
  belief.on_anchor(filter->position() - job.context.track.position, job.context.track.covariance_m2,
                   filter->position_covariance_m2());
  operator_hint.reset();
  placed = true;
  tracking.on_anchor(job.segment == tracking.segment());

  // The frames that were tracked meanwhile, again. A frame that is anchored is no outlier.
  before_now.reset();
  if (job.step + 1 < steps.size()) steps[job.step + 1].motion_over_outlier.reset();
  for (std::size_t i = job.step + 1; i < steps.size(); ++i) {
    const auto before = std::exchange(before_now, TrackBefore{*filter, published.withheld_m, matching.last});
    if (steps[i].motion_over_outlier && before) {
      filter = before->filter;
      published.withheld_m = before->withheld_m + apply_step_over(*filter, steps[i - 1], steps[i], true);
    } else {
      published.withheld_m += apply_step(*filter, steps[i], true);
      if (!steps[i].relative_motion) published.withheld_m.setZero();
    }
  }
  // The last frame was processed with the heading of before: no motion from it is linear about a far one.
  if (std::abs(wrap_pi(filter->state()[FlightFilter::heading] - heading_before_rad)) >
      parameters::tracking::kContradictedTurn_rad) {
    odometry->reset();
    tracking.unlink();
  }
  return pose;
}

// ---- Publishing

// What no number of anchors averages out: the map's own error, and the unmodelled errors that grow with height.
Eigen::Matrix2d Localizer::Impl::shared_error_m2(double map_sigma_m) const {
  if (tiles == nullptr) return Eigen::Matrix2d::Zero();
  return Eigen::Matrix2d::Identity() * (map_sigma_m * map_sigma_m + unmodelled_variance_m2(telemetry.reference.agl_m));
}

Estimate Localizer::Impl::estimate(bool anchored) const {
  Estimate estimate;
  estimate.frame = telemetry.last.frame;
  estimate.time_s = telemetry.last.time_s;
  estimate.segment = tracking.segment();
  if (last_anchor) {
    estimate.anchor_age_s = std::max(telemetry.last.time_s - last_anchor->time_s, 0.0);  // clocks may be set back
    estimate.anchor_inliers = last_anchor->inliers;
    estimate.anchor_ratio = last_anchor->ratio;
  }
  if (!placed) return estimate;
  const bool tracked = tracking.tracked();
  const Eigen::Matrix2d track_m2 =
      filter->position_covariance_m2() + published.withheld_m * published.withheld_m.transpose();
  Eigen::Matrix2d common_m2 = Eigen::Matrix2d::Zero();
  if (last_anchor) common_m2 = shared_error_m2(published.map_sigma_m);
  estimate.covariance_m2 = belief.spread_m2(track_m2) + common_m2;
  estimate.hpl_m = belief.protection_level_m(track_m2, config.integrity_risk, common_m2);
  estimate.sigma_m = std::sqrt(0.5 * estimate.covariance_m2.trace());
  estimate.source = anchored                                               ? SourceLabel::satellite_anchored
                    : tracked && (tracking.unbroken() || tiles == nullptr) ? SourceLabel::vo_extrapolated
                                                                           : SourceLabel::dead_reckoned;
  if (steps.size() == 1 && !anchored) estimate.source = SourceLabel::dead_reckoned;
  if (estimate.sigma_m > config.no_fix_sigma_m) estimate.source = SourceLabel::no_fix;
  if (estimate.source != SourceLabel::no_fix) {
    estimate.position = frame.lonlat_from_plane(filter->position() - published.withheld_m);
  }
  return estimate;
}

FramePose Localizer::Impl::anchor_pose(const AnchorJob& job) const {
  FramePose result;
  result.pose = camera_pose(filter->state(), job.reference);
  result.covariance_m2 = filter->position_covariance_m2() + shared_error_m2(published.map_sigma_m);
  result.sigma_m = std::sqrt(0.5 * result.covariance_m2.trace());
  result.source = SourceLabel::satellite_anchored;
  const double variance_m2 = job.context.track.covariance_m2.trace() / 2;
  const Eigen::Vector2d correction_m = filter->position() - job.flight.position();
  const bool predicted = job.context.anchored && variance_m2 <= kSharp_m * kSharp_m &&
                         job.segment == tracking.segment() && correction_m.squaredNorm() <= kChi2_999 * variance_m2;
  result.confirmed = predicted || steps[job.step].anchor_unambiguous;
  result.motion = camera_motion(filter->state(), steps[job.step]);
  return result;
}

// ---- After the flight

FlownFlight Localizer::Impl::flown() const {
  return {.initial = *initial,
          .steps = steps,
          .frame = frame,
          .no_fix_sigma_m = config.no_fix_sigma_m,
          .anchored = last_anchor.has_value(),
          .shared_error_m2 = [this](double map_sigma_m) { return shared_error_m2(map_sigma_m); }};
}

std::vector<Estimate> Localizer::refined() const {
  const Impl& s = *impl_;
  return s.placed && s.filter ? refined_estimates(s.published.estimates, s.flown()) : s.published.estimates;
}

std::vector<std::optional<FramePose>> Localizer::refined_poses() const {
  const Impl& s = *impl_;
  if (!s.placed || !s.filter) return std::vector<std::optional<FramePose>>(s.steps.size());
  return nadir::refined_poses(s.flown());
}

std::vector<SmoothedFrame> Localizer::smoothed() const {
  const Impl& s = *impl_;
  if (!s.placed || !s.filter) return {};
  return smoothed_frames(s.flown(), *s.filter);
}

}  // namespace nadir
