#include "flights/segment_placer.hpp"

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include "base/error.hpp"
#include "estimation/map_look.hpp"
#include "geodesy/angles.hpp"
#include "vision/localizer_parameters.hpp"

namespace nadir {
namespace {

// A frame continues the one before it or, over an outlier, the one before that.
constexpr std::size_t kContinuedBy = 2;
constexpr std::size_t kMostAttempts = 60;  // of a flight: bounds the time of a flight that matches nowhere
constexpr double kReachSigmas = 3;         // of a predicted place; chosen

nlohmann::json finite(double value) { return std::isfinite(value) ? nlohmann::json(value) : nlohmann::json(nullptr); }

StoredFlightEvent event_of(FlightEventKind kind, std::size_t frame, const nlohmann::json& body) {
  return {kind, frame, body.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace)};
}

}  // namespace

struct SegmentPlacer::Attempt {
  FlightSegment segment;
  Inputs inputs;
  std::unique_ptr<SegmentPlacement> placement;
  std::optional<SearchRung> reported;  // the last rung that an event was written for
  double reported_m = 0;
};

SegmentPlacer::SegmentPlacer(FlightStore& store, const PlacerSetup& setup) : store_(store), setup_(setup) {}

SegmentPlacer::~SegmentPlacer() = default;

PlacerOutcome SegmentPlacer::step(Scope scope, const Cancel& cancel) {
  if (!attempt_ && !begin_next(scope)) {
    matcher_.reset();  // and the tiles that it keeps
    return PlacerOutcome::nothing_to_do;
  }
  report_rung();
  if (attempt_->placement->step(cancel)) return PlacerOutcome::more_to_do;
  const bool merged = finish();
  attempt_.reset();
  return merged ? PlacerOutcome::merged : PlacerOutcome::more_to_do;
}

bool SegmentPlacer::begin_next(Scope scope) {
  const std::size_t processed = store_.processed();
  for (const FlightSegment& segment : store_.segments()) {
    if (segment.state != SegmentState::floating || segment.first_frame == segment.last_frame) continue;
    if (scope == Scope::closed && segment.last_frame + kContinuedBy >= processed) continue;
    std::vector<PlaceStatement> stated = statements_about(segment);
    const Inputs inputs{segment.last_frame, stated.size()};
    const auto before = tried_.find(segment.number);
    if (before != tried_.end() && before->second == inputs) continue;
    tried_[segment.number] = inputs;
    if (store_.merge_taken_back(segment)) continue;
    SegmentShape shape = stored_shape(store_, segment, setup_.camera.uncertainty);
    if (!SegmentPlacement::possible(shape, setup_.camera.camera) || attempts_ >= kMostAttempts) continue;
    ++attempts_;
    if (!matcher_) {
      const GroundSurface* surface = setup_.localizer.surface;
      matcher_ = setup_.localizer.matcher(
          {setup_.camera.camera, setup_.tiles, setup_.frame, surface != nullptr ? *surface : flat_});
    }
    const PlacementMap map{.camera = setup_.camera,
                           .matcher = *matcher_,
                           .area = setup_.localizer.area,
                           .places = setup_.localizer.places,
                           .read = setup_.read};
    attempt_ = std::make_unique<Attempt>();
    attempt_->segment = segment;
    attempt_->inputs = inputs;
    attempt_->placement = std::make_unique<SegmentPlacement>(std::move(shape), map, stated, prediction_of(segment));
    return true;
  }
  return false;
}

SegmentShape stored_shape(const FlightStore& store, const FlightSegment& segment,
                          const TelemetryUncertainty& uncertainty) {
  const std::size_t count = segment.last_frame - segment.first_frame + 1;
  const std::vector<Estimate> online = store.estimates(EstimateKind::online, segment.first_frame, count);
  std::vector<ObservedFrame> observed;
  for (std::size_t i = 0; i < online.size(); ++i) {
    if (online[i].segment != segment.number) continue;  // an outlier within
    ObservedFrame& frame = observed.emplace_back();
    frame.frame = segment.first_frame + i;
    frame.telemetry = store.picture(frame.frame).telemetry;
    StoredFrame stored = store.stored_frame(frame.frame);
    auto answers = decode_answers(stored.answers);
    if (!answers) {
      throw Error({.what = "the stored flight is damaged: what vision found in frame " + std::to_string(frame.frame),
                   .fix = "get the flight from a backup, or process its pictures again"});
    }
    frame.estimate = stored.online.estimate;
    frame.state = stored.online.state;
    frame.look = store.look_of(frame.frame);
    frame.answers = std::move(*answers);
  }
  return segment_shape(observed, uncertainty);
}

// Where people say that one of its frames was taken. A pixel shows a place that is as far as the picture reaches.
std::vector<PlaceStatement> SegmentPlacer::statements_about(const FlightSegment& segment) const {
  std::vector<PlaceStatement> stated;
  for (const UserFix& fix : store_.fixes()) {
    if (fix.withdrawn) continue;
    const std::size_t frame = fix.frame.value_or(fix.before_frame);
    if (frame < segment.first_frame || frame > segment.last_frame) continue;
    double reach_m = fix.radius_m;
    if (fix.pixel) {
      const double agl_m = store_.picture(frame).telemetry.agl_m.value_or(parameters::localizer::kAssumedAgl_m);
      reach_m += footprint_side_m(setup_.camera.camera, agl_m);
    }
    stated.push_back({frame, setup_.frame.plane_from_lonlat(fix.place), reach_m});
  }
  return stated;
}

// By the online estimate of the frame that knows its place best.
std::optional<PlaceStatement> SegmentPlacer::prediction_of(const FlightSegment& segment) const {
  const std::size_t count = segment.last_frame - segment.first_frame + 1;
  const std::vector<Estimate> online = store_.estimates(EstimateKind::online, segment.first_frame, count);
  std::optional<PlaceStatement> best;
  for (std::size_t i = 0; i < online.size(); ++i) {
    if (online[i].segment != segment.number || !online[i].position) continue;
    const double reach_m = kReachSigmas * online[i].sigma_m;
    if (best && best->reach_m <= reach_m) continue;
    best = PlaceStatement{segment.first_frame + i, setup_.frame.plane_from_lonlat(*online[i].position), reach_m};
  }
  return best;
}

// The ladder, as it is climbed.
void SegmentPlacer::report_rung() {
  Attempt& now = *attempt_;
  const SearchRung rung = now.placement->rung();
  if (now.reported == rung || now.placement->searched_all()) return;
  const double reach_m = now.placement->reach_m();
  if (now.reported) {
    store_.append_event_once(
        event_of(
            FlightEventKind::search_expanded, now.segment.first_frame,
            {{"segment", now.segment.number}, {"by", name_of(rung)}, {"from_m", now.reported_m}, {"to_m", reach_m}}),
        setup_.clock());
  }
  now.reported = rung;
  now.reported_m = reach_m;
}

double common_variance_m2(const LocalizerConfig& config, const std::optional<double>& map_ce90_m, double agl_m) {
  double map_sigma_m = parameters::localizer::kMapSigma_m;
  if (map_ce90_m) map_sigma_m = map_sigma_from_ce90(*map_ce90_m);
  if (config.map_sigma_m) map_sigma_m = *config.map_sigma_m;
  return map_sigma_m * map_sigma_m + unmodelled_variance_m2(agl_m);
}

EstimateRecord placed_estimate(const FlightStore& store, const PlacerSetup& setup, const ShapeFrame& frame,
                               const SegmentSimilarity::Pose& pose, double common_m2, SourceLabel source) {
  Estimate estimate = store.estimates(EstimateKind::online, frame.frame, 1).front();
  estimate.covariance_m2 = pose.covariance_m2 + common_m2 * Eigen::Matrix2d::Identity();
  estimate.sigma_m = std::sqrt(estimate.covariance_m2.trace() / 2);
  estimate.hpl_m.reset();
  estimate.source = source;
  estimate.position = setup.frame.lonlat_from_plane(pose.position);
  if (estimate.sigma_m > setup.localizer.no_fix_sigma_m) {
    estimate.source = SourceLabel::no_fix;
    estimate.position.reset();
  }
  StateEstimate state;
  state.heading_rad = pose.heading_rad;
  state.heading_sigma_rad = pose.heading_sigma_rad;
  state.agl_m = pose.agl_m;
  state.agl_sigma_m = pose.agl_m * pose.log_agl_sigma;
  return {frame.frame, estimate, {}, state};
}

bool SegmentPlacer::finish() {
  const Attempt& now = *attempt_;
  const SegmentPlacementResult result = now.placement->result();
  if (result.poses.empty()) {
    nlohmann::json candidates = nlohmann::json::array();
    for (const PlaceCandidateOfFrame& candidate : result.candidates) {
      const LonLat place = setup_.frame.lonlat_from_plane(candidate.position);
      candidates.push_back({{"lat_deg", place.lat_deg},
                            {"lon_deg", place.lon_deg},
                            {"heading_deg", degrees(candidate.heading_rad)},
                            {"likeness", finite(candidate.likeness)},
                            {"posterior", finite(candidate.posterior)},
                            {"radius_m", finite(candidate.radius_m)}});
    }
    if (candidates.empty()) return false;
    store_.append_event_once(
        event_of(FlightEventKind::user_input_needed, result.candidates.front().frame,
                 {{"segment", now.segment.number}, {"looks", result.looks}, {"candidates", candidates}}),
        setup_.clock());
    return false;
  }
  std::vector<EstimateRecord> placed;
  double worst_m = 0;
  for (std::size_t i = 0; i < result.poses.size(); ++i) {
    const ShapeFrame& frame = now.placement->shape().frames[i];
    const double common_m2 = common_variance_m2(setup_.localizer, result.map_ce90_m, frame.agl_m);
    const SourceLabel source = result.hit[i] ? SourceLabel::satellite_anchored : SourceLabel::vo_extrapolated;
    placed.push_back(placed_estimate(store_, setup_, frame, result.poses[i], common_m2, source));
    worst_m = std::max(worst_m, placed.back().estimate.sigma_m);
  }
  const LonLat first = setup_.frame.lonlat_from_plane(result.poses.front().position);
  const StoredFlightEvent event = event_of(FlightEventKind::segments_merged, now.segment.first_frame,
                                           {{"segment", now.segment.number},
                                            {"by", "map"},
                                            {"frames", placed.size()},
                                            {"looks", result.looks},
                                            {"hits", result.hits},
                                            {"log_likelihood", finite(result.log_odds)},
                                            {"doubt", finite(result.doubt)},
                                            {"lat_deg", first.lat_deg},
                                            {"lon_deg", first.lon_deg},
                                            {"turn_deg", degrees(result.turn_rad)},
                                            {"scale", std::exp(result.log_scale)},
                                            {"sigma_m", finite(worst_m)}});
  return store_.merge_segment(now.segment, placed, event, setup_.clock());
}

}  // namespace nadir
