#include "gps_tracks.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <sstream>

#include "base/error.hpp"
#include "estimation/drawn_flight.hpp"
#include "estimation/localizer.hpp"
#include "geodesy/angles.hpp"
#include "safety_camera.hpp"
#include "service/service_rules.hpp"
#include "simulation/camera_sensor.hpp"
#include "simulation/noise.hpp"
#include "simulation/telemetry_noise.hpp"

namespace nadir::bench {
namespace {

using Eigen::Vector2d;

constexpr double kInterval_s = 0.5;
constexpr double kMapSigma_m = 2, kMapErrorTime_s = 60;  // over some kilometres of ground
constexpr double kLeg_m = 900, kRow_m = 150;

// Parallel rows over the middle of the world and back across them, in a direction drawn from the seed.
PlanePath lanes(double along) {
  constexpr int kRows = 7;
  PlanePath route;
  for (const double direction : {along, along + kPi / 2}) {
    for (int row = 0; row < kRows; ++row) {
      for (const double end : {row % 2 == 0 ? -0.5 : 0.5, row % 2 == 0 ? 0.5 : -0.5}) {
        const double x = end * kLeg_m, y = (row - (kRows - 1) / 2.0) * kRow_m;
        route.push_back(
            {x * std::sin(direction) + y * std::cos(direction), x * std::cos(direction) - y * std::sin(direction)});
      }
    }
  }
  return route;
}

}  // namespace

std::string line(const Track& track) {
  std::string text = fmt::format("{}", track.index);
  for (const TrackPoint& p : track.points) {
    text += fmt::format(",{:.2f} {:.2f} {:.2f} {:.2f} {:.2f} {:.2f} {:.2f} {:.2f} {:d}", p.time_s, p.truth_m.x(),
                        p.truth_m.y(), p.estimate_m.x(), p.estimate_m.y(), p.velocity_mps.x(), p.velocity_mps.y(),
                        p.sigma_m, p.visual);
  }
  return text + "\n";
}

Track track_of(const std::string& text) {
  Track track;
  std::istringstream in(text);
  std::string cell;
  std::getline(in, cell, ',');
  track.index = std::stoull(cell);
  while (std::getline(in, cell, ',')) {
    TrackPoint p;
    std::istringstream numbers(cell);
    numbers >> p.time_s >> p.truth_m.x() >> p.truth_m.y() >> p.estimate_m.x() >> p.estimate_m.y() >>
        p.velocity_mps.x() >> p.velocity_mps.y() >> p.sigma_m >> p.visual;
    if (!numbers) throw Error({.what = "a track cannot be read", .found = cell});
    track.points.push_back(p);
  }
  return track;
}

Track draw_track(std::uint64_t base_seed, std::uint64_t index, int frames) {
  const Random base(hash_of(base_seed, static_cast<std::int64_t>(index)));
  test::DrawnOptions options;
  options.frames = frames;
  options.interval_s = kInterval_s;
  options.anchor_every = index % 4 == 1 ? 40 : 4;
  if (index % 4 == 2) options.blind_every = 100;
  const test::DrawnFlight flight = draw_flight(base.fork("flight"), options);
  Random map = base.fork("map");
  const auto draw = [&] { return Vector2d(map.normal(0, kMapSigma_m), map.normal(0, kMapSigma_m)); };
  const double keep = std::exp(-kInterval_s / kMapErrorTime_s);
  Track track{.index = index, .points = {}};
  Vector2d map_error_m = draw();
  bool lost = true;
  for (std::size_t i = 0; i < flight.frames.size(); ++i) {
    const test::DrawnFrame& frame = flight.frames[i];
    lost = frame.blind || (lost && !flight.steps[i].anchor);
    map_error_m = keep * map_error_m + std::sqrt(1 - keep * keep) * draw();
    track.points.push_back({.time_s = kInterval_s * static_cast<double>(i),
                            .truth_m = frame.truth_m,
                            .estimate_m = frame.online_m + map_error_m,
                            .velocity_mps = frame.velocity_mps,
                            .sigma_m = std::sqrt(frame.covariance_m2.trace() / 2 + kMapSigma_m * kMapSigma_m),
                            .visual = !lost});
  }
  return track;
}

Track fly_track(std::uint64_t base_seed, std::uint64_t index, int frames, const World& world) {
  const std::uint64_t seed = hash_of(base_seed, static_cast<std::int64_t>(index));
  const Random base(seed);
  Random path_random = base.fork("path"), light = base.fork("light"), start = base.fork("start");
  FlightPathOptions options;
  options.agl_m = path_random.uniform(160, 240);
  options.speed_mps = 20;
  options.max_frames = frames;
  options.interval_s = kInterval_s;
  const std::vector<FlightPose> path =
      simulate_flight_path(lanes(path_random.uniform(-kPi, kPi)), GroundShape(), options, seed);
  CameraFile file = camera_file();
  const Photographer photographer(file.camera);
  const CameraSensor sensor({file.camera.width, file.camera.height}, file.camera.fx, seed);
  TelemetryNoise noise(file.uncertainty, seed);
  // As nadird flies: the attitude is that of an autopilot that may follow our fix.
  file.uncertainty.heading_rad = std::max(file.uncertainty.heading_rad, kFixAidedHeading_rad);
  file.uncertainty.tilt_rad = std::max(file.uncertainty.tilt_rad, kFixAidedTilt_rad);
  LocalizerConfig config;
  config.start_sigma_m = 30;
  config.map_sigma_m = world.map_sigma_m;
  config.surface = &world.terrain;
  const double north_m = start.normal(0, 30), east_m = start.normal(0, 30);
  const LonLat begin =
      frame().lonlat_from_plane({path.front().position.x() + east_m, path.front().position.y() + north_m});
  Localizer localizer(file, frame(), &world.map, begin, config);
  Track track{.index = index, .points = {}};
  for (std::size_t i = 0; i < path.size(); ++i) {
    const CameraPose truth{{path[i].position.x(), path[i].position.y()}, path[i].agl_m, path[i].attitude};
    Exposure exposure;
    exposure.gain = light.uniform(0.85, 1.25);
    exposure.warmth = light.uniform(-1, 1);
    exposure.motion_px = {light.normal(0, 0.3), light.normal(0, 0.5)};
    cv::Mat picture = photographer.photograph(world, truth);
    sensor.expose(picture, exposure, i);
    const MeasuredPose measured = noise.measure(path[i]);
    Telemetry telemetry;
    telemetry.time_s = measured.time_s;
    telemetry.agl_m = measured.agl_m;
    telemetry.heading_rad = measured.attitude.heading_rad;
    telemetry.pitch_rad = measured.attitude.pitch_rad;
    telemetry.roll_rad = measured.attitude.roll_rad;
    const FrameReport report = localizer.process(picture, telemetry);
    TrackPoint point{.time_s = measured.time_s, .truth_m = truth.position.vector()};
    point.sigma_m = -1;
    if (const Estimate& estimate = report.estimate; estimate.position) {
      point.estimate_m = frame().plane_from_lonlat(*estimate.position).vector();
      point.velocity_mps = report.state.velocity_mps;
      point.sigma_m = estimate.sigma_m;
      point.visual =
          estimate.source == SourceLabel::satellite_anchored || estimate.source == SourceLabel::vo_extrapolated;
    }
    track.points.push_back(point);
  }
  return track;
}

}  // namespace nadir::bench
