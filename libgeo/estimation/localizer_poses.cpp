// The camera's pose of a frame that the map has confirmed: in flight and afterwards.
#include <cmath>

#include "estimation/anchor_job.hpp"
#include "estimation/localizer_state.hpp"

namespace nadir {
namespace {

constexpr double kWitness_s = 60;          // an anchor as far off in time says little
constexpr double kSharpPrediction_m = 20;  // one axis: a wider one agrees with much

CameraPose pose_of(const FlightFilter::State& x, double measured_agl_m, const Eigen::Vector2d& measured_tilt_rad) {
  CameraPose pose;
  pose.position = {x[FlightFilter::east], x[FlightFilter::north]};
  pose.agl_m = measured_agl_m * std::exp(x[FlightFilter::log_height]);
  pose.attitude = {x[FlightFilter::heading], measured_tilt_rad.x() + x[FlightFilter::pitch],
                   measured_tilt_rad.y() + x[FlightFilter::roll]};
  return pose;
}

// Another anchor that odometry leads to without a break.
bool witnessed(const std::vector<FlightStep>& steps, const std::vector<bool>& kept, std::size_t at) {
  double passed_s = 0;
  for (std::size_t i = at; i > 0 && steps[i].moved; --i) {
    passed_s += steps[i].seconds;
    if (passed_s > kWitness_s) break;
    if (kept[i - 1]) return true;
  }
  passed_s = 0;
  for (std::size_t i = at + 1; i < steps.size() && steps[i].moved; ++i) {
    passed_s += steps[i].seconds;
    if (passed_s > kWitness_s) break;
    if (kept[i]) return true;
  }
  return false;
}

}  // namespace

FramePose Localizer::State::anchored_pose(const AnchorJob& job) const {
  FramePose result;
  result.pose = pose_of(flight->state(), job.measured_agl_m, job.measured_tilt_rad);
  result.covariance_m2 = flight->position_covariance_m2() + shared_error_m2();
  result.sigma_m = std::sqrt(0.5 * result.covariance_m2.trace());
  result.source = SourceLabel::satellite_anchored;
  const Eigen::Vector2d moved_m = flight->position_m() - job.flight.position_m();
  const bool led_here =
      job.prediction.healthy && job.prediction.sigma_m <= kSharpPrediction_m && !broken_since_job &&
      moved_m.squaredNorm() <= config.gates.chi2_999 * job.prediction.sigma_m * job.prediction.sigma_m;
  result.confirmed = led_here || log[job.step].anchored_clearly;
  return result;
}

std::vector<std::optional<FramePose>> Localizer::refined_poses() const {
  const State& s = *state_;
  std::vector<std::optional<FramePose>> poses(s.log.size());
  if (!s.placed || !s.flight) return poses;
  const SmoothedFlight smoothed = smooth_flight(*s.fresh, s.log);
  std::vector<bool> kept(s.log.size());
  for (std::size_t i = 0; i < s.log.size(); ++i) kept[i] = s.log[i].anchored.has_value();
  for (const std::size_t i : smoothed.switched_off) kept[i] = false;
  for (std::size_t i = 0; i < poses.size(); ++i) {
    if (!kept[i]) continue;
    FramePose& result = poses[i].emplace();
    result.pose = pose_of(smoothed.frames[i].state, s.log[i].measured_agl_m, s.log[i].measured_tilt_rad);
    result.covariance_m2 = smoothed.frames[i].covariance_m2 + s.shared_error_m2();
    result.sigma_m = std::sqrt(0.5 * result.covariance_m2.trace());
    result.source = SourceLabel::satellite_anchored;
    result.confirmed = s.log[i].anchored_clearly || witnessed(s.log, kept, i);
    result.refined = true;
  }
  return poses;
}

}  // namespace nadir
