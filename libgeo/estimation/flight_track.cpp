#include "estimation/flight_track.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include "estimation/terrain_surface.hpp"
#include "geodesy/angles.hpp"
#include "geodesy/hypotenuse.hpp"
#include "vision/localizer_parameters.hpp"
#include "vision/matching_plan.hpp"

namespace nadir {
namespace {

LinearizationPoint linearization_point(const FlightFilter::State& x) {
  return {x[FlightFilter::log_height], x[FlightFilter::heading], x[FlightFilter::pitch], x[FlightFilter::roll]};
}

}  // namespace

FlightTrack::FlightTrack(const CameraFile& camera, const GroundSurface& surface,
                         std::unique_ptr<OdometryFrontEnd> odometry, const TrackStart& start)
    : camera_(camera.camera),
      readout_(camera.readout),
      on_gimbal_(camera.on_gimbal),
      uncertainty_(camera.uncertainty),
      surface_(&surface),
      odometry_(std::move(odometry)),
      start_(start),
      tracking_(start.known) {}

double FlightTrack::footprint_m() const { return footprint_side_m(camera_, telemetry_.reference.agl_m); }

double FlightTrack::new_ground() const {
  if (!last_look_) return 1;
  double way_m = (filter_->position() - last_look_->position).norm();
  if (last_look_->segment != tracking_.segment()) {  // nothing measured the way
    const auto& covariance = filter_->covariance();
    const double speed_variance =
        covariance.block<2, 2>(FlightFilter::velocity_east, FlightFilter::velocity_east).trace();
    way_m = hypotenuse(way_m, std::sqrt(speed_variance) * (telemetry_.last.time_s - last_look_->time_s));
  }
  return std::min(1.0, way_m / footprint_m());
}

// ---- Prediction

double FlightTrack::predict(const Telemetry& measured) {
  telemetry_.tilt_logged = telemetry_.tilt_logged || measured.pitch_rad.has_value();  // NaN too: other frames have it
  before_last_ = std::exchange(before_now_, std::nullopt);
  if (filter_) before_now_.emplace(TrackBefore{*filter_, withheld_m_, last_look_});

  const Telemetry plausible = plausible_telemetry(measured, telemetry_.last_time_s.value_or(0));
  const double seconds = telemetry_.last_time_s ? plausible.time_s - *telemetry_.last_time_s : 0;
  telemetry_.height_steady = telemetry_.height_measured && plausible.agl_m;
  telemetry_.height_measured = plausible.agl_m.has_value();
  TelemetryReference& reference = telemetry_.reference;
  if (telemetry_.height_measured) reference.agl_m = *plausible.agl_m;
  if (reference.agl_m <= 0) reference.agl_m = start_.assumed_agl_m;
  reference.tilt_rad = {plausible.pitch_rad.value_or(0), plausible.roll_rad.value_or(0)};
  telemetry_.last_time_s = plausible.time_s;
  telemetry_.last = plausible;

  if (!filter_) {
    filter_.emplace(uncertainty_, telemetry_.tilt_logged, start_.position, start_.sigma_m);
    filter_->set_latitude(start_.latitude_rad);
    initial_ = filter_;
  }
  FlightStep& step = steps_.emplace_back();
  step.seconds = seconds;
  step.intervals = plausible.intervals;
  step.measured_heading_rad = plausible.heading_rad;
  step.tilt_measured = plausible.pitch_rad && plausible.roll_rad;
  step.imu_dv_mps = plausible.imu_dv_mps;
  if (!on_gimbal_ && steps_.size() > 1) {  // a gimbal turns without the sensor
    step.inertial = preintegrate_parts(plausible.inertial, plausible.time_s - seconds, plausible.time_s);
  }
  step.reference = reference;
  step.rate_rad_s = plausible.rate_rad_s.value_or(Eigen::Vector3d::Zero());
  propagate_to(*filter_, step);
  if (!telemetry_.height_steady) {
    step.height_reset_sigma =
        telemetry_.height_measured ? uncertainty_.agl_relative : parameters::tracking::kUnmeasuredHeightSigma;
    filter_->reset_height(*step.height_reset_sigma);
  }
  return seconds;
}

// ---- Rolling shutter

// With a global shutter it is so already. Without an image, as when a flight is restored, the motion alone is noted.
cv::Mat FlightTrack::at_one_moment(const cv::Mat& as_read) {
  if (!readout_) return as_read;
  const CameraPose pose = camera_pose(filter_->state(), telemetry_.reference);
  shutter_motion_ = {.attitude = pose.attitude,
                     .agl_m = pose.agl_m,
                     .velocity_mps = filter_->state().segment<2>(FlightFilter::velocity_east),
                     .rate_rad_s = telemetry_.last.rate_rad_s.value_or(Eigen::Vector3d::Zero())};
  return as_read.empty() ? as_read : without_rolling_shutter(as_read, camera_, *readout_, shutter_motion_);
}

// Odometry may have found that the velocity was another: at the beginning none was known. The frame is then undone
// anew, for the map and for the next frame's odometry; grey: as it was undone first.
cv::Mat FlightTrack::at_one_moment_again(const cv::Mat& as_read, const cv::Mat& grey) {
  if (!readout_) return grey;
  const Eigen::Vector2d found_mps = filter_->state().segment<2>(FlightFilter::velocity_east);
  if ((found_mps - shutter_motion_.velocity_mps).norm() * readout_->duration_s < kShutterRedone_m) return grey;
  cv::Mat again = at_one_moment(as_read);
  odometry_->reset();
  odometry_->track(odometry_frame(again));
  return again;
}

// ---- Odometry

TrackedMotion FlightTrack::update_with_odometry(const cv::Mat& as_read, bool usable) {
  TrackedMotion result;
  result.grey = usable ? at_one_moment(as_read) : as_read;
  // Two images hardly determine a motion when one may be tilted by 20 degrees.
  FrameLink link{.first = steps_.size() == 1, .comparable = usable && !filter_->tilt_missing()};
  link.expected_overlap = tracking_.expects_overlap(*filter_, steps_.back().seconds, footprint_m());
  if (link.comparable) {
    const OdometryFrame seen = odometry_frame(result.grey);
    link.tracked = update_with_motion(seen, result);
    link.over_outlier = !link.tracked && update_over_outlier(seen, result);
    result.odometry.tracked = link.tracked || link.over_outlier;
    result.grey = at_one_moment_again(as_read, result.grey);
  } else {
    odometry_->reset();
  }
  tracking_.on_frame(link);
  if (!tracking_.tracked()) withheld_m_.setZero();
  return result;
}

OdometryFrame FlightTrack::odometry_frame(const cv::Mat& grey) const {
  using namespace parameters::tracking;
  const CameraPose pose = camera_pose(filter_->state(), telemetry_.reference);
  const double footprint = footprint_side_m(camera_, pose.agl_m);
  OdometryFrame seen;
  seen.grey = grey;
  if (readout_) seen.undone = UndoneShutter{*readout_, shutter_motion_};
  seen.camera = camera_;
  seen.linearization_point = linearization_point(filter_->state());
  seen.agl_m = pose.agl_m;
  seen.attitude = pose.attitude;
  seen.heading_sigma_rad = telemetry_.last.heading_rad
                               ? std::max(kMinTurnSigma_rad, kTurnSigmaShare * uncertainty_.heading_rad)
                               : kUnknownTurnSigma_rad;
  if (filter_->inertial())
    seen.heading_sigma_rad = std::max(parameters::inertial::kLeastTurnSigma_rad, filter_->turn_sigma_rad());
  seen.tilt_sigma_rad = filter_->white_tilt_sigma_rad();
  // An unknown slope of the ground tilts both images alike, as an unknown boresight does.
  const double slope = surface_->relief_sigma_m() / footprint;
  seen.boresight_covariance_rad2 =
      filter_->covariance().block<2, 2>(FlightFilter::pitch_bias, FlightFilter::pitch_bias) +
      slope * slope * Eigen::Matrix2d::Identity();
  seen.ground_slope = ground_slope(*surface_, pose.position, footprint / kSlopeBaselineDivisor);
  seen.relief_sigma_m = surface_->relief_sigma_m();
  seen.relative_height_sigma =
      telemetry_.height_steady ? kSteadyHeightShare * uncertainty_.agl_relative : kUnmeasuredHeightSigma;
  return seen;
}

// As the filter takes it.
RelativeMotionMeasurement FlightTrack::measured_motion(const OdometryStep& motion, const OdometryFrame& seen) const {
  RelativeMotionMeasurement measurement = motion.measurement;
  inflate_unknown_slope(measurement, surface_->relief_sigma_m() / footprint_side_m(camera_, seen.agl_m));
  return measurement;
}

// predicted: before the filter takes it.
MotionEvidence FlightTrack::motion_evidence(const FlightFilter& predicted, const RelativeMotionMeasurement& measurement,
                                            int inliers) const {
  const FlightFilter::MotionFit fit = predicted.motion_fit(measurement);
  const double shorter =
      static_cast<double>(std::min(camera_.width, camera_.height)) / std::max(camera_.width, camera_.height);
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
TrackedMotion::Taken FlightTrack::taken(const Eigen::Vector2d& correction_m, MotionEvidence evidence) const {
  evidence.velocity_mps -= filter_->state().segment<2>(FlightFilter::velocity_east);
  return {.correction_m = correction_m,
          .track = {filter_->position(), filter_->position_covariance_m2()},
          .evidence = evidence};
}

void FlightTrack::watch_course(bool turn_contradicted, double step_m) {
  FlightStep& step = steps_.back();
  step.wrong_course_sigma_m = course_.on_step(turn_contradicted, filter_->sigma(FlightFilter::heading), step_m);
  if (step.wrong_course_sigma_m) filter_->inflate_position(*step.wrong_course_sigma_m);
}

bool FlightTrack::update_with_motion(const OdometryFrame& seen, TrackedMotion& result) {
  const auto motion = odometry_->track(seen);
  if (!motion) return false;
  result.odometry.inliers = motion->inliers;
  result.odometry.step_m = motion->displacement_m.norm();
  FlightStep& step = steps_.back();
  if (exceeds_reach(*filter_, result.odometry.step_m, step.seconds, footprint_m())) return false;
  const RelativeMotionMeasurement measurement = measured_motion(*motion, seen);
  if (contradicts_inertial(*filter_, measurement)) {
    if (++inertial_contradictions_ < parameters::inertial::kRefusedInARow) return false;
    inertial_contradictions_ = 0;
    step.inertial_refused_sigma_m = parameters::inertial::kRefusedInARow * filter_->motion_innovation_m(measurement);
    filter_->refuse_inertial(*step.inertial_refused_sigma_m);
    return false;
  }
  inertial_contradictions_ = 0;
  if (is_chance_motion(*filter_, measurement, motion->inliers)) return false;
  const double turn_rad = std::abs(wrap_pi(measurement.value[3]));
  const bool contradicted = contradicts_turn(turn_rad, seen.heading_sigma_rad);
  if (contradicted) {
    step.contradicted_turn_rad = turn_rad;
    filter_->inflate_heading(turn_rad);
  } else {
    const MotionEvidence evidence = motion_evidence(*filter_, measurement, motion->inliers);
    const Eigen::Vector2d correction_m = filter_->update_relative(measurement);
    withheld_m_ += correction_m;
    corrected_m_ += correction_m;
    result.taken = taken(correction_m, evidence);
    step.relative_motion = measurement;
  }
  watch_course(contradicted, result.odometry.step_m);
  return !contradicted;
}

// The last frame did not continue the one before it, and this one does not continue the last. If it continues the one
// before the last, two of three show the same ground: the last one is the outlier, and the track goes on from the frame
// before it as if the last one had only brought its telemetry.
bool FlightTrack::update_over_outlier(const OdometryFrame& seen, TrackedMotion& result) {
  FlightStep& step = steps_.back();
  if (step.inertial_refused_sigma_m) return false;
  if (!tracking_.broken() || !before_last_ || step.contradicted_turn_rad || step.height_reset_sigma) return false;
  const FlightStep& outlier = steps_[steps_.size() - 2];
  if (outlier.anchor || outlier.height_reset_sigma || outlier.contradicted_turn_rad || outlier.hint_sigma_m)
    return false;
  const auto motion = odometry_->track_over_last();
  if (!motion) return false;
  FlightFilter bridged = before_last_->filter;
  propagate_over(bridged, outlier, step);
  const double step_m = motion->displacement_m.norm();
  if (exceeds_reach(bridged, step_m, outlier.seconds + step.seconds, footprint_m())) return false;
  const RelativeMotionMeasurement measurement = measured_motion(*motion, seen);
  if (is_chance_motion(bridged, measurement, motion->inliers)) return false;
  if (contradicts_inertial(bridged, measurement)) return false;
  if (contradicts_turn(std::abs(wrap_pi(measurement.value[3])), seen.heading_sigma_rad)) return false;
  result.odometry.inliers = motion->inliers;
  result.odometry.step_m = step_m;
  const MotionEvidence evidence = motion_evidence(bridged, measurement, motion->inliers);
  const Eigen::Vector2d correction_m = bridged.update_relative(measurement);
  filter_ = bridged;
  step.motion_over_outlier = measurement;
  withheld_m_ = before_last_->withheld_m + correction_m;
  corrected_m_ += correction_m;
  last_look_ = before_last_->last_look;
  result.taken = taken(correction_m, evidence);
  watch_course(false, step_m);
  return true;
}

// ---- Anchors and hints

double FlightTrack::return_to(std::size_t step, const FlightFilter& then) {
  const double heading_rad = filter_->state()[FlightFilter::heading];
  const FlightStep& anchored = steps_[step];
  filter_ = then;
  if (anchored.contradicted_anchor_sigma_m) filter_->inflate_position(*anchored.contradicted_anchor_sigma_m);
  if (anchored.finer_map_sigma_m) filter_->inflate_position(*anchored.finer_map_sigma_m);
  return heading_rad;
}

void FlightTrack::update_absolute(std::size_t step, const PoseMeasurement& anchor) {
  steps_[step].anchor = anchor;
  filter_->update_absolute(anchor);
  withheld_m_.setZero();
  last_look_->position = filter_->position();
}

void FlightTrack::repeat_later_steps(std::size_t step, int segment, double heading_before_rad) {
  tracking_.on_anchor(segment == tracking_.segment());
  before_now_.reset();  // a frame that is anchored is no outlier
  if (step + 1 < steps_.size()) steps_[step + 1].motion_over_outlier.reset();
  for (std::size_t i = step + 1; i < steps_.size(); ++i) {
    const auto before = std::exchange(before_now_, TrackBefore{*filter_, withheld_m_, last_look_});
    if (steps_[i].motion_over_outlier && before) {
      filter_ = before->filter;
      withheld_m_ = before->withheld_m + apply_step_over(*filter_, steps_[i - 1], steps_[i], true);
    } else {
      withheld_m_ += apply_step(*filter_, steps_[i], true);
      if (!steps_[i].relative_motion) withheld_m_.setZero();
    }
  }
  // The last frame was processed with the heading of before: no motion from it is linear about a far one.
  if (std::abs(wrap_pi(filter_->state()[FlightFilter::heading] - heading_before_rad)) >
      parameters::tracking::kContradictedTurn_rad) {
    odometry_->reset();
    tracking_.unlink();
  }
}

void FlightTrack::inflate_for_hint(double sigma_m) {
  steps_.back().hint_sigma_m = sigma_m;
  filter_->inflate_position(sigma_m);
}

}  // namespace nadir
