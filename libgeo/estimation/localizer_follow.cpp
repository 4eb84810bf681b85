// How the camera moved since the last frame, and whether that can be.
#include <algorithm>
#include <cmath>

#include "estimation/localizer_state.hpp"
#include "estimation/sloping_ground.hpp"
#include "geodesy/angles.hpp"

namespace nadir {
namespace {

constexpr double kSurelyShared = 0.5;  // of a picture's longer side: so much shorter a way leaves an overlap
constexpr double kFastestSigmas = 4.5, kGusts_mps = 5;
constexpr double kSightSlack = 0.1;  // of a picture's longer side: what a tilt feigns
constexpr double kContradictedTurn_rad = 0.5, kTurnSigmas = 5;
constexpr double kVagueHeading_rad = 0.5;

}  // namespace

// The last picture was seen with a heading so far off that no step from it is linear about what is known now.
void Localizer::State::forget_picture_if_turned(double heading_before_rad) {
  if (std::abs(wrap_pi(believed().heading_rad - heading_before_rad)) <= kContradictedTurn_rad) return;
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
         speed_below_mps(2, 0) * std::abs(seconds) < kSurelyShared * footprint_side_m(camera, measured_agl_m);
}

// No turn and no gust carries an aircraft so far: the pictures overlap, but one of them was not taken there and then.
bool Localizer::State::leaps(double step_m) const {
  const double seconds = std::abs(log.back().seconds);
  if (log.size() == 1 || seconds == 0) return false;  // a clock that stands tells no speed
  return step_m >
         speed_below_mps(kFastestSigmas, kGusts_mps) * seconds + kSightSlack * footprint_side_m(camera, measured_agl_m);
}

bool Localizer::State::follow(const cv::Mat& grey, const Telemetry& telemetry, OdometryReport& report) {
  OdometryFrame seen;
  seen.grey = grey;
  seen.camera = camera;
  seen.believed = believed();
  const CameraPose pose = predicted_pose();
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
  seen.relative_height_sigma = height_steady ? 0.5 * uncertainty.agl_relative : kUnmeasuredHeightSigma;
  const auto step = odometry->track(seen);
  if (!step) return false;
  report.inliers = step->inliers;
  report.step_m = step->moved_m.norm();
  if (leaps(report.step_m)) return false;
  RelativeMotionMeasurement sight = step->sight;
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

}  // namespace nadir
