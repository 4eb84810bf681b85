#include "estimation/localizer.hpp"

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>
#include <utility>

#include "base/error.hpp"
#include "estimation/flight_track.hpp"
#include "estimation/refined_flight.hpp"
#include "estimation/search_window.hpp"
#include "geodesy/angles.hpp"
#include "geodesy/web_mercator.hpp"

namespace nadir {
namespace {

using namespace parameters::anchor_measurement;
using namespace parameters::belief;
using namespace parameters::localizer;
using namespace parameters::search_window;

struct LastAnchor {
  double time_s = 0;
  PlanePoint position;  // matched
  int inliers = 0;
  double ratio = 1;
};

struct MatchState {
  bool job_out = false;  // a frame is being matched with the map
  bool last_failed = false;
};

// What is published beside the track.
struct Published {
  double map_sigma_m = 0;  // of the map that the track is anchored to: of the tiles of the last anchor
  std::vector<Estimate> estimates;
};

cv::Mat grey_of(const cv::Mat& image) {
  cv::Mat grey = image;
  if (image.channels() == 3) cv::cvtColor(image, grey, cv::COLOR_BGR2GRAY);
  return grey;
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

struct Localizer::Impl {
  Impl(const CameraFile& camera_file, const LocalFrame& local_frame, const TileSource* map_tiles,
       std::optional<LonLat> known_start, LocalizerConfig localizer_config)
      : camera(camera_file.camera),
        on_gimbal(camera_file.on_gimbal),
        frame(local_frame),
        tiles(map_tiles),
        start(known_start),
        config(std::move(localizer_config)),
        surface(config.surface != nullptr ? config.surface : &flat),
        matcher(tiles != nullptr ? config.matcher({camera, *tiles, frame, *surface}) : nullptr),
        frame_checker(config.frame_checker()),
        track(camera_file, *surface, config.odometry(), track_start()),
        placed(known_start.has_value()),
        belief(known_start ? kStartDoubt : 1, config.area.value_or(around_start())),
        window(config.min_search_radius_m, config.max_search_radius_m, config.area) {}

  // The steps of a frame, in order.
  void weigh_motion(const TrackedMotion& motion);
  std::unique_ptr<AnchorJob> begin_match(const cv::Mat& grey);
  FramePose update_with_anchor(const AnchorJob& job, const AnchorReport& report, double association_doubt);
  Estimate estimate(bool anchored) const;

  TrackStart track_start() const;
  PlaneBox around_start() const;  // as far as a window may reach
  bool match_due() const;
  bool too_low_to_match() const;
  void apply_hint();
  void weigh_hint(const TrackPrediction& prediction);
  AnchorPrior anchor_prior() const;
  std::function<bool(const AnchorMatch&, double)> settles(const LookContext& context) const;  // AnchorPrior's
  LostSearch lost_search();
  FramePose anchor_pose(const AnchorJob& job) const;  // with the filter at the job's frame

  std::function<double(const PlanePoint&)> detection_odds() const;  // by the matchability map
  void widen_for_another_map(LookContext& context, const AnchorMatch& match) const;

  const FlightFilter& filter() const { return track.filter(); }
  TrackPrediction prediction() const { return {filter().position(), filter().position_covariance_m2()}; }
  bool lost() const { return window.lost(placed, filter().position_sigma_m()); }
  Eigen::Matrix2d shared_error_m2(double map_sigma_m) const;
  FlownFlight flown() const;

  // Fixed for the flight. A job that is out uses these and what it was given, nothing else.
  CameraModel camera;
  bool on_gimbal;
  LocalFrame frame;
  const TileSource* tiles;
  std::optional<LonLat> start;
  LocalizerConfig config;
  FlatGround flat;
  const GroundSurface* surface;
  std::unique_ptr<MapMatcher> matcher;  // none without a map

  std::unique_ptr<FrameChecker> frame_checker;
  FlightTrack track;
  bool placed;  // the start is known, or an anchor has been accepted since
  std::optional<LastAnchor> last_anchor;
  PlaceBelief belief;
  SearchWindow window;
  std::optional<OperatorHint> operator_hint;
  MatchState matching;
  Published published;
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

  s.belief.propagate(s.track.predict(measured));
  const TrackedMotion motion = s.track.update_with_odometry(as_read, usable);
  s.weigh_motion(motion);
  result.report.odometry = motion.odometry;
  if (usable) {
    result.job = s.begin_match(motion.grey);
  } else {
    result.report.anchor.verdict = AnchorVerdict::frame_unfit;
  }
  result.report.estimate = s.estimate(false);
  result.report.state = state_estimate(s.filter(), s.track.reference());
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
        PlanePoint(job->context.track.position.vector() + s.track.corrected_m() - job->corrected_m);
    Look look = look_of(*job->match, job->context);
    if (s.config.matchability != nullptr) look.detection_odds = s.detection_odds();
    s.weigh_hint(job->context.track);  // one that came while the frame was matched
    if (job->match->on_map) result = s.belief.update(look, job->context.track);
    report.anchor = anchor_report(*job->match, job->context, look, result);
    s.window.record_attempt(report.anchor.verdict);
    s.matching.last_failed = !result.accepted;
    s.track.on_look({job->time_s, job->segment, job->context.track.position});
    if (result.contradicted) {
      s.track.step(job->step).contradicted_anchor_sigma_m =
          (look.candidate->position - job->context.track.position).norm();
    }
  }
  const bool anchored = result.accepted;
  if (anchored) report.anchor_pose = s.update_with_anchor(*job, report.anchor, result.association_doubt);
  s.matching.job_out = false;
  report.estimate = s.estimate(anchored && job->step + 1 == s.track.steps().size());
  report.state = state_estimate(s.filter(), s.track.reference());
  s.published.estimates.back() = report.estimate;
  return report;
}

// ---- The track

// Without a start: anywhere in the area.
TrackStart Localizer::Impl::track_start() const {
  TrackStart result{.known = start.has_value(),
                    .latitude_rad = radians(frame.origin().lat_deg),
                    .assumed_agl_m = config.assumed_agl_m};
  const PlaneBox box = config.area.value_or(PlaneBox{});
  result.position = start ? frame.plane_from_lonlat(*start) : box.middle();
  result.sigma_m =
      start ? config.start_sigma_m : std::max({kLeastLostSigma_m, box.east_m - box.west_m, box.north_m - box.south_m});
  return result;
}

PlaneBox Localizer::Impl::around_start() const {
  return square_around(start ? frame.plane_from_lonlat(*start) : PlanePoint{}, config.max_search_radius_m);
}

void Localizer::Impl::weigh_motion(const TrackedMotion& motion) {
  if (!motion.taken) return;
  belief.on_odometry(motion.taken->correction_m, motion.taken->track.covariance_m2);
  belief.on_motion(motion.taken->evidence, motion.taken->track);
}

// ---- Matching with the map

bool Localizer::Impl::match_due() const {
  if (config.anchor_every_m <= 0 || !last_anchor || !track.tracking().unbroken() || matching.last_failed) return true;
  if ((filter().position() - last_anchor->position).norm() >= config.anchor_every_m) return true;
  const double certain_m =
      config.anchor_above_sigma_m * std::sqrt(-2 * kTailVarianceFactor * std::log(config.integrity_risk));
  const auto level_m =
      belief.protection_level_m(filter().position_covariance_m2(), config.integrity_risk, Eigen::Matrix2d::Zero());
  return !level_m || *level_m > certain_m;
}

// On the ground and right after take-off an image shows a few pixels of the map, which are everywhere: searching all of
// the area for them takes a minute, in which no other frame is matched.
bool Localizer::Impl::too_low_to_match() const {
  const double map_gsd_m = ground_resolution_m(tiles->zooms().max, frame.origin().lat_deg);
  return lost() && track.footprint_m() < kMinFootprint_px * map_gsd_m;
}

std::unique_ptr<AnchorJob> Localizer::Impl::begin_match(const cv::Mat& grey) {
  if (matching.job_out || tiles == nullptr || (!placed && !config.area) || !match_due() || too_low_to_match()) {
    return nullptr;
  }
  apply_hint();
  LookContext context;
  context.prior = anchor_prior();
  context.lost = lost();
  context.anchored = last_anchor && track.tracking().unbroken();
  context.track = prediction();
  context.track.stands = placed && (last_anchor ? context.anchored : !config.resumed);
  context.continues_track = !track.tracking().broken();
  context.new_ground = track.new_ground();
  context.agl_m = track.reference().agl_m;
  context.footprint_m = track.footprint_m();
  context.tilt_missing = filter().tilt_missing();
  context.window = square_around(context.prior.search.pose.position, context.prior.search.radius_m);
  std::optional<LostSearch> where;
  if (context.lost) {
    where = lost_search();
    context.window = where->area;
  }
  // NOLINTNEXTLINE(clang-analyzer-cplusplus.NewDeleteLeaks): the analyzer cannot follow what a std::function owns
  auto match_frame = [this, grey, where, begin = context.prior, settles = settles(context)](const Cancel& cancel) {
    AnchorPrior prior = begin;
    prior.settles = settles;
    prior.cancel = cancel;
    return where ? match_lost(*matcher, config.places, grey, prior, *where) : matcher->match(grey, prior);
  };
  matching.job_out = true;
  return std::make_unique<AnchorJob>(AnchorJob{.match_frame = std::move(match_frame),
                                               .match = std::nullopt,
                                               .step = track.steps().size() - 1,
                                               .time_s = track.telemetry().time_s,
                                               .segment = track.tracking().segment(),
                                               .reference = track.reference(),
                                               .flight = filter(),
                                               .context = context,
                                               .corrected_m = track.corrected_m(),
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
  const double height_sigma = std::max(kMinHeightSigma, filter().sigma(FlightFilter::log_height));
  prior.search.pose = camera_pose(filter().state(), track.reference());
  prior.search.radius_m = window.radius_m(filter().position_sigma_m());
  prior.heading_sigma_rad = filter().sigma(FlightFilter::heading);
  prior.search.heading_range_rad = std::min(kPi, kHeadingSigmas * prior.heading_sigma_rad);
  prior.search.scale_range = kScaleSigmas * height_sigma;
  prior.log_agl_sigma = height_sigma;
  prior.tilt_covariance_rad2 = filter().covariance().block<2, 2>(FlightFilter::pitch, FlightFilter::pitch) +
                               kMinTiltVariance_rad2 * Eigen::Matrix2d::Identity();
  return prior;
}

LostSearch Localizer::Impl::lost_search() {
  const PlanePoint position = filter().position();
  const double sigma_m = filter().position_sigma_m();
  LostSearch where{window.reachable_area(placed, position, sigma_m), std::nullopt, {}};
  if (operator_hint) where.hint = operator_hint->box(position, sigma_m, config.area);
  where.part = window.next_part(where.area, position);
  return where;
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

void Localizer::Impl::weigh_hint(const TrackPrediction& prediction) {
  if (!operator_hint || !operator_hint->begin_weighing()) return;
  belief.on_hint({operator_hint->at(), operator_hint->radius_m() / kHintSigmas}, prediction);
}

// A start that was given before has no more weight than a hint that is given now.
void Localizer::Impl::apply_hint() {
  if (!operator_hint || operator_hint->propagating()) return;
  const TrackPrediction before = prediction();
  weigh_hint(before);
  const double off_m = (operator_hint->at() - before.position).norm();
  const bool anchored = track.tracking().unbroken() && last_anchor;
  if (placed && !anchored && off_m > operator_hint->radius_m() + kOutsideHintSigmas * filter().position_sigma_m()) {
    track.inflate_for_hint(off_m);
    belief.on_anchor(Eigen::Vector2d::Zero(), before.covariance_m2, filter().position_covariance_m2());
  }
  operator_hint->start_propagation(filter().position(), filter().position_sigma_m());
}

// ---- Update with an accepted anchor

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

// The errors of one map are common to all of its anchors and cancel between them. Those of two maps do not.
void Localizer::Impl::widen_for_another_map(LookContext& context, const AnchorMatch& match) const {
  const double theirs_m = map_sigma_of(match, config.map_sigma_m), ours_m = published.map_sigma_m;
  if (!last_anchor || theirs_m == ours_m) return;
  const double between_m2 = theirs_m * theirs_m + ours_m * ours_m;
  context.track.covariance_m2 += between_m2 * Eigen::Matrix2d::Identity();
}

// The filter goes back to the job's frame, is updated, and repeats the later steps.
FramePose Localizer::Impl::update_with_anchor(const AnchorJob& job, const AnchorReport& report,
                                              double association_doubt) {
  const AnchorMatch& match = *job.match;
  FlightStep& step = track.step(job.step);
  step.map_sigma_m = map_sigma_of(match, config.map_sigma_m);
  if (last_anchor && step.map_sigma_m < published.map_sigma_m) {
    step.finer_map_sigma_m =
        std::sqrt(published.map_sigma_m * published.map_sigma_m - step.map_sigma_m * step.map_sigma_m);
  }
  published.map_sigma_m = step.map_sigma_m;
  step.anchor_unambiguous = report.log_likelihood_ratio >= kUnambiguous;

  const double heading_before_rad = track.return_to(job.step, job.flight);
  const std::optional<PlanePoint> before = last_anchor ? std::optional(last_anchor->position) : std::nullopt;
  PoseMeasurement anchor = anchor_measurement(match, job.context, job.reference, prediction(), before);
  anchor.covariance = weighted_by_association(anchor.covariance, association_doubt, filter().pose_covariance());
  track.update_absolute(job.step, anchor);
  const FramePose pose = anchor_pose(job);
  last_anchor = LastAnchor{job.time_s, match.solved->pose.position, match.solved->inliers, match.search.ratio};
  belief.on_anchor(filter().position() - job.context.track.position, job.context.track.covariance_m2,
                   filter().position_covariance_m2());
  operator_hint.reset();
  placed = true;
  track.repeat_later_steps(job.step, job.segment, heading_before_rad);
  return pose;
}

// ---- Publishing

Eigen::Matrix2d Localizer::Impl::shared_error_m2(double map_sigma_m) const {
  if (tiles == nullptr) return Eigen::Matrix2d::Zero();
  return nadir::shared_error_m2(map_sigma_m, track.reference().agl_m);
}

Estimate Localizer::Impl::estimate(bool anchored) const {
  Estimate estimate;
  estimate.frame = track.telemetry().frame;
  estimate.time_s = track.telemetry().time_s;
  estimate.segment = track.tracking().segment();
  if (last_anchor) {
    estimate.anchor_age_s = std::max(track.telemetry().time_s - last_anchor->time_s, 0.0);  // clocks may be set back
    estimate.anchor_inliers = last_anchor->inliers;
    estimate.anchor_ratio = last_anchor->ratio;
  }
  if (!placed) return estimate;
  const bool tracked = track.tracking().tracked();
  const Eigen::Matrix2d track_m2 =
      filter().position_covariance_m2() + track.withheld_m() * track.withheld_m().transpose();
  Eigen::Matrix2d common_m2 = Eigen::Matrix2d::Zero();
  if (last_anchor) common_m2 = shared_error_m2(published.map_sigma_m);
  estimate.covariance_m2 = belief.spread_m2(track_m2) + common_m2;
  estimate.hpl_m = belief.protection_level_m(track_m2, config.integrity_risk, common_m2);
  estimate.sigma_m = std::sqrt(0.5 * estimate.covariance_m2.trace());
  estimate.source = anchored                                                       ? SourceLabel::satellite_anchored
                    : tracked && (track.tracking().unbroken() || tiles == nullptr) ? SourceLabel::vo_extrapolated
                                                                                   : SourceLabel::dead_reckoned;
  if (track.steps().size() == 1 && !anchored) estimate.source = SourceLabel::dead_reckoned;
  if (estimate.sigma_m > config.no_fix_sigma_m) estimate.source = SourceLabel::no_fix;
  if (estimate.source != SourceLabel::no_fix) {
    estimate.position = frame.lonlat_from_plane(filter().position() - track.withheld_m());
  }
  return estimate;
}

FramePose Localizer::Impl::anchor_pose(const AnchorJob& job) const {
  FramePose result;
  result.pose = camera_pose(filter().state(), job.reference);
  result.covariance_m2 = filter().position_covariance_m2() + shared_error_m2(published.map_sigma_m);
  result.sigma_m = std::sqrt(0.5 * result.covariance_m2.trace());
  result.source = SourceLabel::satellite_anchored;
  const double variance_m2 = job.context.track.covariance_m2.trace() / 2;
  const Eigen::Vector2d correction_m = filter().position() - job.flight.position();
  const bool predicted = job.context.anchored && variance_m2 <= kSharp_m * kSharp_m &&
                         job.segment == track.tracking().segment() &&
                         correction_m.squaredNorm() <= kChi2_999 * variance_m2;
  result.confirmed = predicted || track.steps()[job.step].anchor_unambiguous;
  result.motion = camera_motion(filter().state(), track.steps()[job.step]);
  return result;
}

// ---- After the flight

FlownFlight Localizer::Impl::flown() const {
  return {.initial = track.initial(),
          .steps = track.steps(),
          .frame = frame,
          .no_fix_sigma_m = config.no_fix_sigma_m,
          .anchored = last_anchor.has_value(),
          .shared_error_m2 = [this](double map_sigma_m) { return shared_error_m2(map_sigma_m); }};
}

std::vector<Estimate> Localizer::refined() const {
  const Impl& s = *impl_;
  return s.placed && s.track.begun() ? refined_estimates(s.published.estimates, s.flown()) : s.published.estimates;
}

std::vector<std::optional<FramePose>> Localizer::refined_poses() const {
  const Impl& s = *impl_;
  if (!s.placed || !s.track.begun()) return std::vector<std::optional<FramePose>>(s.track.steps().size());
  return nadir::refined_poses(s.flown());
}

std::vector<SmoothedFrame> Localizer::smoothed() const {
  const Impl& s = *impl_;
  if (!s.placed || !s.track.begun()) return {};
  return smoothed_frames(s.flown(), s.filter());
}

}  // namespace nadir
