#include "estimation/refined_flight.hpp"

#include <algorithm>
#include <cmath>

#include "vision/localizer_parameters.hpp"

namespace nadir {
namespace {

using parameters::localizer::kCorroborationTime_s;

// Another kept anchor that odometry leads to without a break.
bool corroborated_by_another(const std::vector<FlightStep>& steps, const std::vector<bool>& kept, std::size_t at) {
  double passed_s = 0;
  for (std::size_t i = at; i > 0 && steps[i].relative_motion; --i) {
    passed_s += steps[i].seconds;
    if (passed_s > kCorroborationTime_s) break;
    if (kept[i - 1]) return true;
  }
  passed_s = 0;
  for (std::size_t i = at + 1; i < steps.size() && steps[i].relative_motion; ++i) {
    passed_s += steps[i].seconds;
    if (passed_s > kCorroborationTime_s) break;
    if (kept[i]) return true;
  }
  return false;
}

// Of each frame: it is between two anchors, and the worse of their maps counts.
std::vector<double> map_sigmas_m(const std::vector<FlightStep>& steps) {
  std::vector<double> sigmas_m(steps.size(), 0);
  double last_m = 0;
  for (std::size_t i = 0; i < steps.size(); ++i) {
    if (steps[i].anchor) last_m = steps[i].map_sigma_m;
    sigmas_m[i] = last_m;
  }
  last_m = 0;
  for (std::size_t i = steps.size(); i-- > 0;) {
    if (steps[i].anchor) last_m = steps[i].map_sigma_m;
    sigmas_m[i] = std::max(sigmas_m[i], last_m);
  }
  return sigmas_m;
}

}  // namespace

std::vector<Estimate> refined_estimates(std::vector<Estimate> online, const FlownFlight& flight) {
  const auto smoothed = smooth_flight(flight.initial, flight.steps).frames;
  const std::vector<double> sigmas_m = map_sigmas_m(flight.steps);
  for (std::size_t i = 0; i < online.size(); ++i) {
    Estimate& estimate = online[i];
    estimate.covariance_m2 = smoothed[i].covariance_m2;
    estimate.hpl_m.reset();
    if (flight.anchored) estimate.covariance_m2 += flight.shared_error_m2(sigmas_m[i]);
    estimate.sigma_m = std::sqrt(0.5 * estimate.covariance_m2.trace());
    const bool known = estimate.sigma_m <= flight.no_fix_sigma_m;
    if (!known) estimate.source = SourceLabel::no_fix;
    if (known && estimate.source == SourceLabel::no_fix) estimate.source = SourceLabel::dead_reckoned;
    estimate.position.reset();
    if (known) estimate.position = flight.frame.lonlat_from_plane(smoothed[i].position);
  }
  return online;
}

std::vector<std::optional<FramePose>> refined_poses(const FlownFlight& flight) {
  const std::vector<FlightStep>& steps = flight.steps;
  const SmoothedFlight smoothed = smooth_flight(flight.initial, steps);
  std::vector<bool> kept(steps.size());
  for (std::size_t i = 0; i < steps.size(); ++i) kept[i] = steps[i].anchor.has_value();
  for (const std::size_t i : smoothed.rejected_anchors) kept[i] = false;
  std::vector<std::optional<FramePose>> poses(steps.size());
  for (std::size_t i = 0; i < poses.size(); ++i) {
    if (!kept[i]) continue;
    FramePose& result = poses[i].emplace();
    result.pose = camera_pose(smoothed.frames[i].state, steps[i].reference);
    result.covariance_m2 = smoothed.frames[i].covariance_m2 + flight.shared_error_m2(steps[i].map_sigma_m);
    result.sigma_m = std::sqrt(0.5 * result.covariance_m2.trace());
    result.source = SourceLabel::satellite_anchored;
    result.confirmed = steps[i].anchor_unambiguous || corroborated_by_another(steps, kept, i);
    result.refined = true;
    result.motion = camera_motion(smoothed.frames[i].state, steps[i]);
  }
  return poses;
}

std::vector<SmoothedFrame> smoothed_frames(const FlownFlight& flight, const FlightFilter& last) {
  const std::vector<FlightStep>& steps = flight.steps;
  const SmoothedFlight smoothed = smooth_flight(flight.initial, steps);
  const std::vector<double> sigmas_m = map_sigmas_m(steps);
  const double white_rad = last.white_tilt_sigma_rad();
  std::vector<SmoothedFrame> frames(steps.size());
  for (std::size_t i = 0; i < frames.size(); ++i) {
    SmoothedFrame& frame = frames[i];
    frame.pose = camera_pose(smoothed.frames[i].state, steps[i].reference);
    frame.covariance_m2 = smoothed.frames[i].covariance_m2;
    if (flight.anchored) frame.shared_m2 = flight.shared_error_m2(sigmas_m[i]);
    frame.reference = steps[i].reference;
    frame.tilt_sigma_rad = white_rad;
    frame.anchor = steps[i].anchor;
    frame.continues_flight = steps[i].relative_motion.has_value();
  }
  return frames;
}

}  // namespace nadir
