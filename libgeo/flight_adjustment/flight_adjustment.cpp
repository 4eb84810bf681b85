#include "flight_adjustment/flight_adjustment.hpp"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <utility>

#include "adjustment/adjustment_parameters.hpp"
#include "base/disjoint_sets.hpp"
#include "base/error.hpp"
#include "flights/picture_at_one_moment.hpp"
#include "geodesy/hypotenuse.hpp"

namespace nadir {
namespace {

using namespace parameters::flight_adjustment;
namespace block_table = parameters::adjustment;

using JoinedFrames = DisjointSets<std::size_t>;

// By tie points or odometry, whatever the adjustment makes of it.
JoinedFrames joined_frames(std::span<const SmoothedFrame> frames, const TiePoints& ties) {
  JoinedFrames joined(frames.size());
  for (const auto& point : ties.points) {
    for (const auto& o : point) joined.join(point.front().frame, o.frame);
  }
  for (std::size_t i = 1; i < frames.size(); ++i) {
    if (frames[i].continues_flight) joined.join(i - 1, i);
  }
  return joined;
}

double one_axis_m(const Eigen::Matrix2d& covariance_m2) { return std::sqrt(0.5 * covariance_m2.trace()); }

struct KnownPlace {
  PlanePoint position;
  Eigen::Matrix2d covariance_m2;
};

bool is_placed(const FlightToAdjust& flight, std::size_t i) {
  return i < flight.placed.size() && flight.placed[i] && flight.refined[i].position;
}

// Where the frame is, as far as it is known before.
KnownPlace known_place(const FlightToAdjust& flight, std::size_t i) {
  const SmoothedFrame& frame = flight.smoothed[i];
  if (!is_placed(flight, i)) return {frame.pose.position, frame.covariance_m2};
  return {flight.plane.plane_from_lonlat(*flight.refined[i].position), flight.refined[i].covariance_m2};
}

// The telemetry of a camera: what of it counts in the adjustment, and how much.
class MeasuredFlight {
 public:
  explicit MeasuredFlight(const FlightToAdjust& flight) : flight_(flight) {
    double last_s = 0;
    for (const Telemetry& raw : flight.telemetry) {
      telemetry_.push_back(plausible_telemetry(raw, last_s));
      last_s = telemetry_.back().time_s;
      tilt_logged_ = tilt_logged_ || telemetry_.back().pitch_rad.has_value();
    }
    for (const SmoothedFrame& frame : flight.smoothed) anchored_ = anchored_ || frame.anchor.has_value();
  }

  TieFrame tie_frame(std::size_t i) const {
    const TelemetryUncertainty& sigma = flight_.camera.uncertainty;
    const SmoothedFrame& frame = flight_.smoothed[i];
    TieFrame tie{.pose = start_pose(i),
                 .position_sigma_m = one_axis_m(known_place(flight_, i).covariance_m2),
                 .tilt_sigma_rad = tilt_sigma_rad(i),
                 .heading_sigma_rad = sigma.heading_rad,
                 .log_height_sigma = sigma.agl_relative,
                 .continues_flight = frame.continues_flight};
    if (!anchored_) tie.tilt_sigma_rad = hypotenuse(tie.tilt_sigma_rad, sigma.tilt_rad);  // boresight is not known yet
    return tie;
  }

  AdjustmentFrame frame(std::size_t i) const {
    const TelemetryUncertainty& sigma = flight_.camera.uncertainty;
    const Telemetry& t = telemetry_[i];
    AdjustmentFrame result{.pose = start_pose(i), .attitude = {}, .height = {}, .continues_flight = false};
    result.continues_flight = flight_.smoothed[i].continues_flight;
    AttitudeMeasurement& attitude = result.attitude.emplace();
    attitude.attitude = {t.heading_rad.value_or(result.pose.attitude.heading_rad), t.pitch_rad.value_or(0),
                         t.roll_rad.value_or(0)};
    attitude.tilt_sigma_rad = tilt_sigma_rad(i);
    using namespace parameters::telemetry;
    attitude.heading_sigma_rad = t.heading_rad ? hypotenuse(kDeviationShare, kWhiteHeadingShare) * sigma.heading_rad
                                               : std::sqrt(kUnknownHeadingVariance_rad2);
    if (t.agl_m && *t.agl_m <= block_table::kMaxAgl_m) result.height = {*t.agl_m, sigma.agl_relative};
    return result;
  }

  bool anchored() const { return anchored_; }

  AdjustmentOptions options() const {
    const TelemetryUncertainty& sigma = flight_.camera.uncertainty;
    AdjustmentOptions options;
    options.calibration.boresight_rad = sigma.tilt_rad;
    options.calibration.heading_boresight_rad = parameters::telemetry::kHeadingBiasShare * sigma.heading_rad;
    options.calibration.height_scale = sigma.agl_relative;
    return options;
  }

 private:
  // Of what differs from frame to frame.
  double tilt_sigma_rad(std::size_t i) const {
    const double scatter = flight_.smoothed[i].tilt_sigma_rad;
    const bool measured = telemetry_[i].pitch_rad && telemetry_[i].roll_rad;
    // A logged tilt drifts as well, which a constant boresight does not follow.
    if (measured) return std::max(scatter, flight_.camera.uncertainty.tilt_rad);
    return tilt_logged_ ? hypotenuse(scatter, parameters::flight_filter::kMissingTilt_rad) : scatter;
  }

  CameraPose start_pose(std::size_t i) const {
    CameraPose pose = flight_.smoothed[i].pose;
    pose.position = known_place(flight_, i).position;
    pose.agl_m = std::clamp(pose.agl_m, block_table::kMinDepth_m, block_table::kMaxAgl_m);
    const auto within = [](double at_m) {
      return std::clamp(at_m, -block_table::kMaxPlane_m, block_table::kMaxPlane_m);
    };
    pose.position = {within(pose.position.east_m), within(pose.position.north_m)};
    return pose;
  }

  const FlightToAdjust& flight_;
  std::vector<Telemetry> telemetry_;
  bool tilt_logged_ = false, anchored_ = false;
};

// Variances of a covariance of the filter's range over twelve orders of magnitude, from what the image determines to
// what it does not, so that rounding may leave it indefinite: its correlations are bounded.
Eigen::Matrix<double, 6, 6> regular(const Eigen::Matrix<double, 6, 6>& covariance) {
  const Eigen::Matrix<double, 6, 1> sigmas = covariance.diagonal().cwiseMax(kLeastAnchorVariance).cwiseSqrt();
  const Eigen::Matrix<double, 6, 6> scale = sigmas.cwiseInverse().asDiagonal();
  const Eigen::Matrix<double, 6, 6> scaled = scale * 0.5 * (covariance + covariance.transpose()) * scale;
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix<double, 6, 6>> eigen(scaled);
  const Eigen::Matrix<double, 6, 6> bounded = eigen.eigenvectors() *
                                              eigen.eigenvalues().cwiseMax(kLeastCorrelation).asDiagonal() *
                                              eigen.eigenvectors().transpose();
  const Eigen::Matrix<double, 6, 6> whole = sigmas.asDiagonal() * bounded * sigmas.asDiagonal();
  return 0.5 * (whole + whole.transpose());
}

// The look as it was measured: the filter's values are beyond the telemetry's.
PoseAnchor pose_anchor(std::size_t i, const SmoothedFrame& frame) {
  const Eigen::Matrix<double, 6, 1>& z = frame.anchor->value;
  PoseAnchor anchor;
  anchor.frame = i;
  anchor.pose.position = {z[0], z[1]};
  anchor.pose.agl_m = frame.reference.agl_m * std::exp(z[2]);
  anchor.pose.attitude = {z[3], frame.reference.tilt_rad.x() + z[4], frame.reference.tilt_rad.y() + z[5]};
  anchor.covariance = regular(frame.anchor->covariance);
  return anchor;
}

// An image that determines height or tilt hardly at all may put them anywhere.
bool credible(const PoseMeasurement& anchor) {
  return anchor.value.allFinite() && anchor.covariance.allFinite() &&
         std::abs(anchor.value[2]) < kMostAnchorLogHeight && std::abs(anchor.value[4]) < kMostAnchorTilt_rad &&
         std::abs(anchor.value[5]) < kMostAnchorTilt_rad &&
         anchor.value.head<2>().cwiseAbs().maxCoeff() < block_table::kMaxPlane_m;
}

// Ties to the map, by block, and the holds of blocks that have none.
struct Ties {
  std::vector<std::size_t> anchor_frames;  // of the first anchors, in their order
  std::vector<bool> tied;                  // by the block's root: to the map
};

Ties add_ties_to_map(const FlightToAdjust& flight, const JoinedFrames& joined, BlockAdjustment& block) {
  Ties ties{{}, std::vector<bool>(flight.smoothed.size(), false)};
  for (std::size_t i = 0; i < flight.smoothed.size(); ++i) {
    if (!flight.smoothed[i].anchor || !credible(*flight.smoothed[i].anchor)) continue;
    block.add_anchor(pose_anchor(i, flight.smoothed[i]));
    ties.anchor_frames.push_back(i);
    ties.tied[joined.root(i)] = true;
  }
  for (const FixedPixel& fix : flight.fixes) ties.tied[joined.root(fix.frame)] = true;
  std::vector<std::optional<std::size_t>> best(flight.smoothed.size());  // by root: the frame that is known best
  for (std::size_t i = 0; i < flight.smoothed.size(); ++i) {
    auto& known = best[joined.root(i)];
    const auto sigma = [&](std::size_t j) { return one_axis_m(known_place(flight, j).covariance_m2); };
    if (!known || sigma(i) < sigma(*known)) known = i;
  }
  for (std::size_t root = 0; root < best.size(); ++root) {
    if (!best[root] || ties.tied[root]) continue;
    const KnownPlace known = known_place(flight, *best[root]);
    if (!(one_axis_m(known.covariance_m2) <= flight.no_fix_sigma_m)) continue;
    std::optional<std::size_t> other;  // of a segment that was placed: the frame farthest from that one
    for (std::size_t i = root; i < flight.smoothed.size(); ++i) {
      if (i == *best[root] || joined.root(i) != root || !is_placed(flight, i)) continue;
      const auto away_m = [&](std::size_t j) { return distance_m(known_place(flight, j).position, known.position); };
      if (!other || away_m(i) > away_m(*other)) other = i;
    }
    if (!other || !is_placed(flight, *best[root])) {
      block.add_anchor(PositionAnchor{*best[root], known.position, known.covariance_m2});
      continue;
    }
    // Both err alike: together they say as much as one.
    ties.tied[root] = true;
    for (const std::size_t i : {*best[root], *other}) {
      const KnownPlace place = known_place(flight, i);
      block.add_anchor(PositionAnchor{i, place.position, 2 * place.covariance_m2});
    }
  }
  return ties;
}

Estimate adjusted_estimate(const FlightToAdjust& flight, std::size_t i, const AdjustedFrame& frame, bool tied,
                           bool own_anchor) {
  Estimate estimate = flight.refined[i];
  if (frame.state != FrameState::floating && !frame.covariance) return estimate;  // as good as it was
  estimate.hpl_m.reset();
  estimate.position.reset();
  estimate.source = SourceLabel::no_fix;
  if (!frame.covariance) return estimate;
  const SmoothedFrame& smoothed = flight.smoothed[i];
  const Eigen::Matrix2d own_m2 = frame.covariance->topLeftCorner<2, 2>();
  estimate.covariance_m2 = own_m2 + smoothed.shared_m2;
  estimate.sigma_m = one_axis_m(estimate.covariance_m2);
  if (!(estimate.sigma_m <= flight.no_fix_sigma_m)) return estimate;
  estimate.position = flight.plane.lonlat_from_plane(frame.pose.position);
  const bool linked = frame.observations >= block_table::kWellTied || smoothed.continues_flight;
  tied = tied || flight.refined[i].source == SourceLabel::vo_extrapolated;  // without a map to the start
  estimate.source = own_anchor       ? SourceLabel::satellite_anchored
                    : tied && linked ? SourceLabel::vo_extrapolated
                                     : SourceLabel::dead_reckoned;
  return estimate;
}

std::optional<FramePose> adjusted_pose(const std::optional<FramePose>& refined, const AdjustedFrame& frame,
                                       const Estimate& estimate) {
  if (!refined || !estimate.position || !frame.covariance) return std::nullopt;
  FramePose pose = *refined;
  pose.pose = frame.pose;
  pose.covariance_m2 = estimate.covariance_m2;
  pose.sigma_m = estimate.sigma_m;
  return pose;
}

std::string_view name_of_outcome(AdjustmentOutcome outcome) {
  switch (outcome) {
    case AdjustmentOutcome::converged: return "converged";
    case AdjustmentOutcome::iteration_limit: return "iteration_limit";
    case AdjustmentOutcome::underdetermined: return "underdetermined";
  }
  return {};
}

}  // namespace

FlightToAdjust flight_to_adjust(const FlightStore& store, FlightEngine& engine, const FlightEngineSetup& setup) {
  CameraFile camera = setup.camera;
  camera.camera = camera.camera.scaled(1.0 / setup.shrink);
  FlightToAdjust flight{.camera = camera,
                        .plane = setup.frame,
                        .ground = setup.localizer.surface,
                        .no_fix_sigma_m = setup.localizer.no_fix_sigma_m,
                        .telemetry = {},
                        .smoothed = engine.smoothed(),
                        .refined = engine.refined(),
                        .refined_poses = engine.refined_poses(),
                        .placed = {},
                        .fixes = {},
                        .image_of = {}};
  for (std::size_t i = 0; i < flight.refined.size(); ++i) flight.telemetry.push_back(store.picture(i).telemetry);
  flight.placed.assign(flight.refined.size(), false);
  for (const FlightSegment& segment : store.segments()) {
    if (segment.state != SegmentState::merged) continue;
    for (std::size_t i = segment.first_frame; i <= segment.last_frame && i < flight.refined.size(); ++i) {
      flight.placed[i] = flight.refined[i].segment == segment.number;
    }
  }
  const double scale = 1.0 / setup.shrink;
  for (const UserFix& fix : store.fixes()) {
    if (fix.withdrawn || !fix.frame || !fix.pixel || *fix.frame >= flight.refined.size()) continue;
    // Centres of pixels are whole numbers, so that sizes scale about (-0.5, -0.5).
    const Eigen::Vector2d pixel((fix.pixel->x + 0.5) * scale - 0.5, (fix.pixel->y + 0.5) * scale - 0.5);
    flight.fixes.push_back({*fix.frame, pixel_at_one_moment(store, *fix.frame, camera, pixel),
                            setup.frame.plane_from_lonlat(fix.place), fix.sigma_m});
  }
  flight.image_of = [&store, camera, shrink = setup.shrink](std::size_t frame) {
    return picture_at_one_moment(store, frame, camera, shrink);
  };
  return flight;
}

AdjustedFlight adjust_flight(const FlightToAdjust& flight, Progress& progress, const Cancel& cancel) {
  AdjustedFlight result;
  result.estimates = flight.refined;
  result.poses = flight.refined_poses;
  result.summary.frames = flight.refined.size();
  result.summary.calibration.camera = flight.camera.camera;
  if (flight.smoothed.empty()) {
    result.summary.floating_frames = flight.refined.size();
    return result;
  }
  const FlatGround flat;
  const GroundSurface& ground = flight.ground != nullptr ? *flight.ground : flat;
  const MeasuredFlight measured(flight);
  std::vector<TieFrame> frames;
  for (std::size_t i = 0; i < flight.smoothed.size(); ++i) frames.push_back(measured.tie_frame(i));
  result.ties = find_tie_points(flight.camera.camera, ground, frames, flight.image_of, progress, cancel);

  const CameraModel& camera = result.ties.camera;
  AdjustmentOptions options = measured.options();
  options.point_covariances = false;
  // From above level ground a focal length looks like a height: only the map can tell them apart.
  if (!measured.anchored() && flight.fixes.empty()) options.calibration.focal_relative = 0;
  BlockAdjustment block(camera, ground, options);
  for (std::size_t i = 0; i < flight.smoothed.size(); ++i) block.add_frame(measured.frame(i));
  for (const auto& point : result.ties.points) {
    TiePoint tie;
    for (const auto& o : point) tie.observations.push_back({o.frame, o.pixel});
    block.add_tie_point(tie);
  }
  const double scale = static_cast<double>(camera.width) / flight.camera.camera.width;
  for (const FixedPixel& fix : flight.fixes) {
    const Eigen::Vector2d half(0.5, 0.5), pixel = scale * (fix.pixel + half) - half;
    if (pixel.x() < -0.5 || pixel.y() < -0.5 || pixel.x() > camera.width - 0.5 || pixel.y() > camera.height - 0.5)
      continue;
    block.add_fix(fix.frame, pixel, fix.place, std::max(fix.sigma_m, kLeastFixSigma_m));
    ++result.summary.fixes;
  }
  const JoinedFrames joined = joined_frames(flight.smoothed, result.ties);
  const Ties ties = add_ties_to_map(flight, joined, block);
  result.block = block.adjust(progress, cancel);

  std::vector<bool> own_anchor(flight.smoothed.size(), false);
  for (const AdjustedAnchor& anchor : result.block.anchors) {
    if (anchor.anchor >= ties.anchor_frames.size()) continue;  // a hold
    const std::size_t frame = ties.anchor_frames[anchor.anchor];
    own_anchor[frame] = !anchor.switched_off;
    if (anchor.switched_off) result.summary.switched_off.push_back(frame);
  }
  for (std::size_t i = 0; i < result.estimates.size(); ++i) {
    const AdjustedFrame& frame = result.block.frames[i];
    const bool tied = ties.tied[joined.root(i)];
    result.estimates[i] = adjusted_estimate(flight, i, frame, tied, own_anchor[i]);
    result.poses[i] = own_anchor[i] ? adjusted_pose(flight.refined_poses[i], frame, result.estimates[i]) : std::nullopt;
    const bool anchored = tied && frame.state == FrameState::anchored;
    ++(anchored ? result.summary.anchored_frames : result.summary.floating_frames);
  }
  AdjustmentSummary& summary = result.summary;
  summary.outcome = result.block.outcome;
  for (std::size_t j = 0; j < result.ties.points.size(); ++j)
    summary.tie_points += result.block.points[j].used ? 1U : 0U;
  summary.observations = result.block.observations;
  summary.rejected_observations = result.block.rejected_observations;
  summary.pairs_compared = result.ties.pairs_compared;
  summary.pairs_matched = result.ties.pairs_matched;
  summary.anchors = ties.anchor_frames.size();
  summary.mean_reprojection_px = result.block.mean_reprojection_px;
  summary.rms_reprojection_px = result.block.rms_reprojection_px;
  summary.calibration = result.block.calibration;
  return result;
}

AdjustedPoses adjusted_poses(const AdjustedFlight& adjusted) {
  AdjustedPoses poses;
  const CameraSelfCalibration& calibration = adjusted.summary.calibration;
  poses.lens = {calibration.log_focal.value, calibration.camera.distortion};
  std::vector<std::optional<double>> shared_m(adjusted.estimates.size());  // of frames with a pose: σ of what all share
  for (std::size_t i = 0; i < adjusted.estimates.size() && i < adjusted.block.frames.size(); ++i) {
    const AdjustedFrame& frame = adjusted.block.frames[i];
    const Estimate& estimate = adjusted.estimates[i];
    if (!estimate.position || !frame.covariance) continue;
    AdjustedPose& pose = poses.frames.emplace_back(i, frame.pose.attitude, frame.pose.agl_m, *frame.covariance);
    const Eigen::Matrix2d own_m2 = frame.covariance->topLeftCorner<2, 2>();
    shared_m[i] = std::sqrt(std::max(0.0, 0.5 * (estimate.covariance_m2 - own_m2).trace()));
    pose.covariance.topLeftCorner<2, 2>() = estimate.covariance_m2;
  }
  for (const FrameCrossCovariance& cross : adjusted.block.cross_covariances) {
    if (!shared_m[cross.a] || !shared_m[cross.b]) continue;
    AdjustedPosePair& pair = poses.pairs.emplace_back(cross.a, cross.b, cross.covariance);
    pair.covariance.topLeftCorner<2, 2>() += *shared_m[cross.a] * *shared_m[cross.b] * Eigen::Matrix2d::Identity();
  }
  return poses;
}

std::vector<StoredFlightEvent> refinement_events(const AdjustedFlight& adjusted) {
  std::vector<StoredFlightEvent> events;
  for (std::size_t i = 0; i < adjusted.estimates.size(); ++i) {
    const Estimate& estimate = adjusted.estimates[i];
    if (!estimate.position) continue;
    const nlohmann::json body{{"name", estimate.frame},
                              {"kind", name_of(EstimateKind::adjusted)},
                              {"source", name_of(estimate.source)},
                              {"lat_deg", estimate.position->lat_deg},
                              {"lon_deg", estimate.position->lon_deg},
                              {"sigma_m", estimate.sigma_m}};
    events.push_back(
        {FlightEventKind::frame_refined, i, body.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace)});
  }
  return events;
}

nlohmann::json json_from(const AdjustmentSummary& summary) {
  const auto calibrated = [](const CalibratedValue& value) {
    return nlohmann::json{{"value", value.value}, {"sigma", value.sigma}};
  };
  const CameraSelfCalibration& c = summary.calibration;
  nlohmann::json distortion = nlohmann::json::array(), boresight = nlohmann::json::array();
  for (const CalibratedValue& value : c.distortion) distortion.push_back(calibrated(value));
  for (const CalibratedValue& value : c.boresight) boresight.push_back(calibrated(value));
  return {{"outcome", name_of_outcome(summary.outcome)},
          {"frames", summary.frames},
          {"anchored_frames", summary.anchored_frames},
          {"floating_frames", summary.floating_frames},
          {"tie_points", summary.tie_points},
          {"observations", summary.observations},
          {"rejected_observations", summary.rejected_observations},
          {"pairs_compared", summary.pairs_compared},
          {"pairs_matched", summary.pairs_matched},
          {"anchors", summary.anchors},
          {"anchors_switched_off", summary.switched_off},
          {"fixes", summary.fixes},
          {"mean_reprojection_px", summary.mean_reprojection_px},
          {"rms_reprojection_px", summary.rms_reprojection_px},
          {"picture_width_px", c.camera.width},
          {"calibration",
           {{"log_focal", calibrated(c.log_focal)},
            {"distortion", std::move(distortion)},
            {"boresight_rad", std::move(boresight)},
            {"log_height_scale", calibrated(c.log_height_scale)}}}};
}

}  // namespace nadir
