#include "provision/boresight_sights.hpp"

#include <algorithm>
#include <cmath>

#include "estimation/anchor_acceptance.hpp"
#include "estimation/pose_measurements.hpp"
#include "estimation/terrain_surface.hpp"
#include "geodesy/angles.hpp"
#include "replay/pictures.hpp"
#include "vision/flight_picture.hpp"
#include "vision/place_matcher.hpp"

namespace nadir {
namespace {

constexpr double kMountRange_rad = 0.2;  // how far off the mount may be, each angle
constexpr double kLeastRadius_m = 60;    // of the search around GPS
constexpr double kLongestStep_s = 3;     // between frames, for rates
constexpr double kHealthySigma_m = 20;   // of the prediction that the gates weigh: GPS

bool complete(const Telemetry& told) {
  return told.place && told.agl_m && told.heading_rad && told.pitch_rad && told.roll_rad;
}

// At `at` with its neighbours: where it was, how it moved, how it lay.
BoresightSight sight_of(const std::vector<Telemetry>& frames, std::size_t at, const LocalFrame& frame,
                        const Attitude& told_mount) {
  const auto aircraft = [&](const Telemetry& told) {
    return aircraft_attitude({*told.heading_rad, *told.pitch_rad, *told.roll_rad}, told_mount);
  };
  const auto place = [&](const Telemetry& told) {
    const Enu enu = frame.enu_from_lonlat(*told.place);
    return Eigen::Vector2d(enu.east_m, enu.north_m);
  };
  BoresightSight sight;
  sight.time_s = frames[at].time_s;
  sight.gps_m = place(frames[at]);
  sight.aircraft = aircraft(frames[at]);
  const Telemetry& before = frames[at > 0 && complete(frames[at - 1]) ? at - 1 : at];
  const Telemetry& after = frames[at + 1 < frames.size() && complete(frames[at + 1]) ? at + 1 : at];
  const double step_s = after.time_s - before.time_s;
  if (step_s <= 0 || step_s > 2 * kLongestStep_s) return sight;
  const Attitude first = aircraft(before), last = aircraft(after);
  sight.velocity_mps = (place(after) - place(before)) / step_s;
  sight.rate_rad_s = {wrap_pi(last.heading_rad - first.heading_rad) / step_s,
                      (last.pitch_rad - first.pitch_rad) / step_s, wrap_pi(last.roll_rad - first.roll_rad) / step_s};
  return sight;
}

AnchorPrior prior_of(const BoresightSight& sight, const Attitude& mount, double agl_m,
                     const TelemetryUncertainty& uncertainty) {
  AnchorPrior prior;
  prior.search.pose = {{sight.gps_m.x(), sight.gps_m.y()}, agl_m, camera_attitude(sight.aircraft, mount)};
  prior.search.radius_m = std::max(kLeastRadius_m, 1.5 * agl_m * std::tan(kMountRange_rad));
  prior.heading_sigma_rad = std::hypot(uncertainty.heading_rad, kMountRange_rad / 2);
  prior.search.heading_range_rad = 2 * prior.heading_sigma_rad;
  prior.log_agl_sigma = uncertainty.agl_relative;
  prior.search.scale_range = 2.5 * uncertainty.agl_relative;
  const double tilt_rad = std::hypot(uncertainty.tilt_rad, kMountRange_rad / 2);
  prior.tilt_covariance_rad2 = Eigen::Matrix2d::Identity() * tilt_rad * tilt_rad;
  return prior;
}

std::vector<std::size_t> chosen(const std::vector<Telemetry>& frames, std::size_t most) {
  std::vector<std::size_t> usable, evenly;
  for (std::size_t i = 0; i < frames.size(); ++i) {
    if (complete(frames[i])) usable.push_back(i);
  }
  if (usable.size() <= most) return usable;
  for (std::size_t i = 0; i < most; ++i) evenly.push_back(usable[i * usable.size() / most]);
  return evenly;
}

}  // namespace

BoresightSights find_sights(const BoresightFlight& from, const CameraFile& camera, const Attitude& mount,
                            const OpenPackage& package, Progress& progress) {
  const LocalFrame frame = mission_frame(package.mission());
  const FlatGround flat;
  std::optional<TerrainSurface> terrain;
  if (package.terrain() != nullptr) terrain.emplace(*package.terrain(), frame, package.mission().terrain.height_m);
  const GroundSurface& surface = terrain ? static_cast<const GroundSurface&>(*terrain) : flat;
  const int shrink = harmless_shrink(camera.camera.width, camera.camera.height);
  const CameraModel decoded = camera.camera.scaled(1.0 / shrink);
  const auto matcher = make_channel_matcher({decoded, package.imagery(), frame, surface});

  BoresightSights result;
  const auto& frames = from.flight.frames;
  const std::vector<std::size_t> looked_at = chosen(frames, from.most_frames);
  result.looked_at = looked_at.size();
  progress.begin("looking at the map", looked_at.size(), "frames");
  for (const std::size_t i : looked_at) {
    progress.advance(1);
    const cv::Mat grey = read_flight_picture(from.flight.picture(i), decoded, shrink);
    if (grey.empty()) continue;
    BoresightSight sight = sight_of(frames, i, frame, from.told_mount);
    const AnchorPrior prior = prior_of(sight, mount, *frames[i].agl_m, camera.uncertainty);
    const AnchorMatch match = matcher->match(grey, prior);
    const AnchorPrediction gps{.chi2 = 0, .sigma_m = kHealthySigma_m, .healthy = true, .lost = false};
    if (!match.solved || evaluate_anchor(match, prior, gps) != AnchorVerdict::accepted) continue;
    const PoseMeasurement seen = pose_measurement(*match.solved, {*frames[i].agl_m, Eigen::Vector2d::Zero()});
    sight.seen = seen.value;
    sight.covariance = seen.covariance;
    result.sights.push_back(sight);
  }
  progress.end();
  return result;
}

}  // namespace nadir
