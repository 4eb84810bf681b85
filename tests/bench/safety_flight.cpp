#include "safety_flight.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <opencv2/imgproc.hpp>

#include "geodesy/angles.hpp"
#include "simulation/camera_sensor.hpp"
#include "simulation/telemetry_noise.hpp"
#include "vision/rectification.hpp"

namespace nadir::bench {
namespace {

constexpr double kMiddle_m = 250;  // the path's middle lies so near to the world's
// Of sparse ones: low and short, so that they stay over the world.
constexpr double kSparseMiddle_m = 100, kSparseAgl_m = 150;

PlanePoint offset(PlanePoint from, double distance_m, double direction_rad) {
  return {from.east_m + distance_m * std::sin(direction_rad), from.north_m + distance_m * std::cos(direction_rad)};
}

std::vector<FlightPose> path_of(Random random, std::uint64_t seed, FrameSpacing spacing) {
  FlightPathOptions options;
  options.agl_m = random.uniform(150, 260);
  options.speed_mps = random.uniform(12, 25);
  options.max_frames = random.integer(3, 6);
  double step_m = random.uniform(20, 75), middle_m = kMiddle_m;
  if (spacing == FrameSpacing::sparse) {
    options.agl_m = kSparseAgl_m;
    options.max_frames = std::min(options.max_frames, 4);
    step_m = random.uniform(0.6, 1) * footprint_side_m(camera_file().camera, options.agl_m);
    middle_m = kSparseMiddle_m;
  }
  options.interval_s = step_m / options.speed_mps;
  const double half_m = options.interval_s * options.speed_mps * (options.max_frames + 1) / 2;
  const double direction = random.uniform(-kPi, kPi), turn = random.chance(0.3) ? random.uniform(-2, 2) : 0;
  const PlanePoint middle = {random.uniform(-middle_m, middle_m), random.uniform(-middle_m, middle_m)};
  const PlanePath route = {offset(middle, -half_m, direction), middle, offset(middle, half_m, direction + turn)};
  return simulate_flight_path(route, GroundShape(), options, seed);
}

void expose(const CameraSensor& sensor, cv::Mat& picture, std::size_t index, Random& random) {
  Exposure exposure;
  exposure.gain = random.uniform(0.85, 1.25);
  exposure.warmth = random.uniform(-1, 1);
  exposure.motion_px = {random.normal(0, 0.3), random.normal(0, 0.5)};
  sensor.expose(picture, exposure, index);
}

// Flown over from the right part into the misplaced one, or the other way round.
Border border_at(const CameraPose& pose, const CameraPose& before, bool forwards) {
  const PlanePoint step{pose.position.east_m - before.position.east_m, pose.position.north_m - before.position.north_m};
  return {pose.position, forwards ? step : PlanePoint{-step.east_m, -step.north_m}};
}

bool sees_beyond(const Border& border, const CameraPose& pose) {
  const double reach_m = 0.6 * pose.agl_m;  // to the sides of the image
  for (const double east : {-reach_m, 0.0, reach_m}) {
    for (const double north : {-reach_m, 0.0, reach_m}) {
      const PlanePoint seen{pose.position.east_m + east, pose.position.north_m + north};
      if (border.beyond(tile_under(seen))) return true;
    }
  }
  return false;
}

// What may happen to a single frame. `hit`: the first one that the fault is about.
void damage(Flight& flight, const World& world, const Photographer& photographer, const CameraSensor& sensor,
            Random& random) {
  constexpr double nan = std::numeric_limits<double>::quiet_NaN();
  auto& shots = flight.shots;
  const auto hit = static_cast<std::size_t>(random.integer(1, std::max(1, static_cast<int>(shots.size()) - 2)));
  const Fault fault = flight.condition->fault;
  const double sign = random.chance(0.5) ? 1 : -1, direction = random.uniform(-kPi, kPi);
  const double jump_s = random.chance(0.5) ? -60 : 300;
  const bool lasting = random.chance(0.5);
  if (fault == Fault::map_shift || fault == Fault::map_part) {
    flight.shift = offset({}, flight.condition->amount, direction);
  }
  if (fault == Fault::map_part) flight.border = border_at(shots[hit].truth, shots[hit - 1].truth, lasting);
  for (std::size_t i = 0; i < shots.size(); ++i) {
    Shot& shot = shots[i];
    const bool from_hit = i >= hit;
    switch (fault) {
      case Fault::heading_bias: *shot.telemetry.heading_rad += radians(8); break;
      case Fault::deviation:
        *shot.telemetry.heading_rad += radians(9) * std::sin(shot.truth.attitude.heading_rad + direction);
        break;
      case Fault::height_scale: *shot.telemetry.agl_m *= 1 + 0.15 * sign; break;
      case Fault::map_shift: shot.shifted = true; break;
      case Fault::map_part: shot.shifted = sees_beyond(*flight.border, shot.truth); break;
      case Fault::frozen:
        if (i > hit) shot.picture = shots[hit].picture;
        break;
      case Fault::repeated:
        if (i == hit) shot.picture = shots[i - 1].picture;
        break;
      case Fault::black:
        if (from_hit) shot.picture.setTo(cv::Scalar::all(random.integer(0, 3)));
        break;
      case Fault::clouds: add_clouds(shot.picture, random.uniform(0.2, 0.9), random); break;
      case Fault::blur: cv::GaussianBlur(shot.picture, shot.picture, cv::Size(), random.uniform(2, 8)); break;
      case Fault::night: make_night(shot.picture, random); break;
      case Fault::blackout:
        if (random.chance(0.2)) shot.picture = cv::Mat();
        break;
      case Fault::water:
        if (i == hit || i == hit + 1 || (lasting && from_hit)) {
          shot.picture.setTo(cv::Scalar(68, 62, 44));
          expose(sensor, shot.picture, i, random);
        }
        break;
      case Fault::outlier:
        if (i == hit) {
          CameraPose elsewhere = shot.truth;
          elsewhere.position = offset(elsewhere.position, 350, direction);
          shot.picture = photographer.photograph(world, elsewhere);
          expose(sensor, shot.picture, i, random);
        }
        break;
      case Fault::time_jump:
        if (i == hit || (lasting && from_hit)) shot.telemetry.time_s += jump_s;
        break;
      case Fault::no_attitude:
        if (from_hit || lasting) shot.telemetry.heading_rad = shot.telemetry.pitch_rad = shot.telemetry.roll_rad = nan;
        break;
      case Fault::none:
      case Fault::old_map:
      case Fault::mirrored_map:
      case Fault::other_region: break;
    }
  }
}

void begin(Flight& flight, Random random) {
  const PlanePoint truth = flight.shots.front().truth.position;
  const double kind = random.uniform();
  flight.start_sigma_m = kind < 0.2 ? 8 : kind < 0.6 ? 20 : kind < 0.85 ? 60 : 120;
  const double north_m = random.normal(0, flight.start_sigma_m), east_m = random.normal(0, flight.start_sigma_m);
  if (kind < 0.95) flight.start = frame().lonlat_from_plane({truth.east_m + east_m, truth.north_m + north_m});
  const PlanePoint corner{truth.east_m - random.uniform(50, 750), truth.north_m - random.uniform(50, 750)};
  flight.area = {corner.east_m, corner.north_m, corner.east_m + 800, corner.north_m + 800};
}

}  // namespace

Flight make_flight(std::uint64_t seed, const std::vector<std::unique_ptr<World>>& worlds,
                   const Photographer& photographer, FrameSpacing spacing) {
  const Random base(seed);
  Random draw = base.fork("condition"), light = base.fork("light"), faults = base.fork("faults");
  Flight flight;
  flight.seed = seed;
  flight.condition = &draw_condition(draw);
  flight.world = static_cast<std::size_t>(draw.integer(0, static_cast<int>(worlds.size()) - 1));
  const World& world = *worlds[flight.world];
  const CameraFile file = camera_file();
  const CameraSensor sensor({file.camera.width, file.camera.height}, file.camera.fx, seed);
  TelemetryNoise noise(file.uncertainty, seed);
  for (const FlightPose& pose : path_of(base.fork("path"), seed, spacing)) {
    Shot shot;
    shot.truth = {{pose.position.x(), pose.position.y()}, pose.agl_m, pose.attitude};
    shot.picture = photographer.photograph(world, shot.truth);
    expose(sensor, shot.picture, flight.shots.size(), light);
    const MeasuredPose measured = noise.measure(pose);
    shot.telemetry.time_s = 100 + measured.time_s;
    shot.telemetry.agl_m = measured.agl_m;
    shot.telemetry.heading_rad = measured.attitude.heading_rad;
    shot.telemetry.pitch_rad = measured.attitude.pitch_rad;
    shot.telemetry.roll_rad = measured.attitude.roll_rad;
    flight.shots.push_back(shot);
  }
  damage(flight, world, photographer, sensor, faults);
  begin(flight, base.fork("start"));
  return flight;
}

std::string spacing_name(FrameSpacing spacing) { return spacing == FrameSpacing::sparse ? ", sparse" : ""; }

LocalizerConfig config_of(const Flight& flight, const World& world) {
  LocalizerConfig config;
  config.start_sigma_m = flight.start_sigma_m;
  config.map_sigma_m = world.map_sigma_m;
  config.surface = &world.terrain;
  if (!flight.start) config.area = flight.area;
  return config;
}

}  // namespace nadir::bench
