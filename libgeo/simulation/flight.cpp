#include "simulation/flight.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <opencv2/core.hpp>

#include "base/error.hpp"
#include "base/files.hpp"
#include "base/random.hpp"
#include "geodesy/angles.hpp"
#include "geodesy/hypotenuse.hpp"
#include "imagery/codecs.hpp"
#include "simulation/camera_sensor.hpp"
#include "simulation/frame_renderer.hpp"
#include "simulation/mems_imu.hpp"
#include "simulation/telemetry_noise.hpp"

namespace nadir {
namespace {

constexpr double kOverlap = 0.7;   // of consecutive frames, along track
constexpr int kUsualFrames = 400;  // limit without --frames

PlaneBox box_around(const PlanePath& route, double reach_m) {
  PlaneBox box{1e12, 1e12, -1e12, -1e12};
  for (const PlanePoint& p : route) {
    box.west_m = std::min(box.west_m, p.east_m - reach_m), box.east_m = std::max(box.east_m, p.east_m + reach_m);
    box.south_m = std::min(box.south_m, p.north_m - reach_m), box.north_m = std::max(box.north_m, p.north_m + reach_m);
  }
  return box;
}

void check_route(const WorldRaster& world, const GroundShape& ground, const std::vector<FlightPose>& poses,
                 const LocalFrame& frame, const SimulatedFlightOptions& options) {
  for (const FlightPose& pose : poses) {
    const PlanePoint at(pose.position.head<2>());
    if (!ground.covers(at)) {
      throw UsageError({.what = "the elevation model does not cover the flight",
                        .where = options.dem->string(),
                        .expected = "heights under the whole route",
                        .fix = "use a larger model, or omit --dem to fly over flat ground"});
    }
    if (world.covers(at)) continue;
    const LonLat place = frame.lonlat_from_plane(at);
    throw UsageError({.what = "the route leaves the world",
                      .where = options.world.string(),
                      .expected = "valid pixels under the whole route",
                      .found = fmt::format("none at {:.6f}, {:.6f}", place.lon_deg, place.lat_deg),
                      .fix = "use a larger raster, or the mission that belongs to it"});
  }
}

constexpr double kGyroStep_s = 1e-3;               // of the difference that a rate is
constexpr double kGyroSigma_rad_s = radians(0.3);  // of the autopilot's gyroscopes

CameraPlace place_of(const FlightPose& pose) { return {pose.position, enu_from_camera(pose.attitude)}; }

// About image-up, image-right and the optical axis.
Eigen::Vector3d rate_at(const FlightPath& path, double time_s) {
  return camera_rate(path.at(time_s - kGyroStep_s).attitude, path.at(time_s + kGyroStep_s).attitude, 2 * kGyroStep_s);
}

// Half of the difference that a velocity is: a few of the path's points.
constexpr double kVelocityStep_s = 0.04;

BodyMotion body_at(const FlightPath& path, double time_s) {
  const Eigen::Matrix3d camera = enu_from_camera(path.at(time_s).attitude);
  BodyMotion body{time_s, {}, {}};
  body.enu_from_body << -camera.col(1), camera.col(0), camera.col(2);
  const Eigen::Vector3d way = path.at(time_s + kVelocityStep_s).position - path.at(time_s - kVelocityStep_s).position;
  body.velocity_mps = way / (2 * kVelocityStep_s);
  return body;
}

// From the first frame to the last one, but for the ends of the path.
std::string inertial_table(const FlightPath& path, double last_s, const SimulatedFlightOptions& options,
                           double latitude_rad) {
  std::string table = "time_s,gyro_x_rad_s,gyro_y_rad_s,gyro_z_rad_s,accel_x_mps2,accel_y_mps2,accel_z_mps2\n";
  MemsImu imu({}, latitude_rad, Random(options.seed).fork("inertial"), options.noise == SensorNoise::none);
  const double end_s = std::min(last_s, path.length_m() / options.speed_mps - kVelocityStep_s);
  std::optional<BodyMotion> before;
  for (int i = 0;; ++i) {
    const double time_s = kVelocityStep_s + static_cast<double>(i) / options.imu_hz;
    if (time_s > end_s) return table;
    const BodyMotion now = body_at(path, time_s);
    if (before) {
      const MeasuredRates sample = imu.measure(*before, now);
      const auto &rate = sample.rate_rad_s, &force = sample.force_mps2;
      table += fmt::format("{:.6f},{:.7f},{:.7f},{:.7f},{:.6f},{:.6f},{:.6f}\n", sample.time_s, rate.x(), rate.y(),
                           rate.z(), force.x(), force.y(), force.z());
    }
    before = now;
  }
}

std::string telemetry_row(const std::string& name, const MeasuredPose& measured, bool exact) {
  double heading = std::fmod(degrees(measured.attitude.heading_rad), 360.0);
  if (heading < 0) heading += 360;
  const double pitch = degrees(measured.attitude.pitch_rad), roll = degrees(measured.attitude.roll_rad);
  std::string imu = ",";
  if (measured.imu_dv_mps) {
    imu = fmt::format("{:.{}f},{:.{}f}", measured.imu_dv_mps->x(), exact ? 6 : 3, measured.imu_dv_mps->y(),
                      exact ? 6 : 3);
  }
  if (exact) {
    return fmt::format("{},{:.3f},{:.4f},{:.6f},{:.6f},{:.6f},{}\n", name, measured.time_s, measured.agl_m, heading,
                       pitch, roll, imu);
  }
  return fmt::format("{},{:.3f},{:.2f},{:.2f},{:.2f},{:.2f},{}\n", name, measured.time_s, measured.agl_m, heading,
                     pitch, roll, imu);
}

}  // namespace

FlightReport simulate_flight(const Mission& mission, const SimulatedFlightOptions& options,
                             const std::filesystem::path& folder, Progress& progress) {
  const CameraFile file = read_camera_file(options.camera);
  const CameraModel& camera = file.camera;
  const double agl = mission.route.agl_m;
  if (mission.route.points.size() < 2 || !(agl > 0)) {
    throw UsageError({.what = "the mission has no route to fly",
                      .where = mission.id,
                      .expected = "at least two route points and a height above ground"});
  }
  const LonLat start = mission.route.points.front();
  const double base_m = options.dem ? GroundShape::height_at(*options.dem, start) : mission.terrain.height_m;
  const LocalFrame frame(start, base_m);
  const PlanePath route = to_plane(frame, mission.route.points);
  // The farthest distance that a banked camera sees.
  const double half_diagonal = hypotenuse(camera.width / camera.fx, camera.height / camera.fy) / 2;
  const double reach = agl * std::tan(std::min(std::atan(half_diagonal) + radians(34), radians(75))) + 50;
  const PlaneBox box = box_around(route, reach);
  const double gsd = agl / std::max(camera.fx, camera.fy);
  const WorldRaster world(options.world, frame, box, gsd);
  const GroundShape ground = options.dem ? GroundShape(*options.dem, frame, box) : GroundShape();

  FlightPathOptions path;
  path.agl_m = agl;
  path.speed_mps = options.speed_mps;
  const double spacing = (1 - kOverlap) * camera.height / camera.fy * agl;
  path.interval_s = options.interval_s.value_or(std::max(0.04, std::round(spacing / options.speed_mps * 100) / 100));
  path.max_frames = options.max_frames.value_or(kUsualFrames);
  const std::vector<FlightPose> poses = simulate_flight_path(route, ground, path, options.seed);
  const FlightPath between(route, ground, path, options.seed);
  check_route(world, ground, poses, frame, options);

  const FrameRenderer renderer(camera, world, ground);
  const CameraSensor sensor({camera.width, camera.height}, camera.fx, options.seed);
  TelemetryNoise noise(file.uncertainty, options.seed);
  const ExposureControl exposure(camera, options.seed);
  std::filesystem::create_directory(folder / "frames");
  const std::string rates = file.readout ? ",roll_rate_deg_s,pitch_rate_deg_s,yaw_rate_deg_s" : "";
  Random gyro = Random(options.seed).fork("gyro");
  std::string telemetry =
                  "frame,time_s,agl_m,heading_deg,pitch_deg,roll_deg,imu_dv_east_mps,imu_dv_north_mps" + rates + "\n",
              truth = "frame,lat_deg,lon_deg,alt_m\n";
  FlightReport report;
  report.interval_s = path.interval_s;
  progress.begin("flying", poses.size(), "frames");
  for (std::size_t i = 0; i < poses.size(); ++i) {
    const FlightPose& pose = poses[i];
    RenderedFrame rendered =
        file.readout ? renderer.render(*file.readout,
                                       [&](double seconds) { return place_of(between.at(pose.time_s + seconds)); })
                     : renderer.render(pose.position, pose.attitude);
    if (rendered.covered_fraction < 0.999) ++report.frames_beyond_world;
    if (options.noise == SensorNoise::real) {
      sensor.expose(rendered.image, exposure.of(pose, i), i);
    }
    const std::string name = fmt::format("frame_{:04}.jpg", i + 1);
    write_file_atomic(folder / "frames" / name, encode_image(rendered.image, ImageFormat::jpeg, 92));
    const bool exact = options.noise == SensorNoise::none;
    const auto before = i > 0 ? std::optional(poses[i - 1]) : std::nullopt;
    const MeasuredPose measured =
        exact ? MeasuredPose{pose.time_s, pose.agl_m, pose.attitude, velocity_change(before, pose)}
              : noise.measure(pose);
    telemetry += telemetry_row(name, measured, exact);
    if (file.readout) {
      Eigen::Vector3d rate_rad_s = rate_at(between, pose.time_s);
      for (double& axis : rate_rad_s) axis += exact ? 0 : kGyroSigma_rad_s * gyro.normal();
      telemetry.pop_back();
      telemetry += fmt::format(",{:.3f},{:.3f},{:.3f}\n", degrees(rate_rad_s.x()), degrees(rate_rad_s.y()),
                               degrees(rate_rad_s.z()));
    }
    const Geodetic at = frame.geodetic_from_enu({pose.position.x(), pose.position.y(), pose.position.z()});
    truth += fmt::format("{},{:.9f},{:.9f},{:.3f}\n", name, at.place.lat_deg, at.place.lon_deg, at.height_m);
    if (i > 0) report.length_m += (pose.position - poses[i - 1].position).head<2>().norm();
    progress.advance(1);
  }
  progress.end();
  write_file_atomic(folder / "telemetry.csv", telemetry);
  write_file_atomic(folder / "truth.csv", truth);
  if (options.imu_hz > 0 && !poses.empty()) {
    write_file_atomic(folder / "imu.csv",
                      inertial_table(between, poses.back().time_s, options, radians(start.lat_deg)));
  }
  write_file_atomic(folder / "camera.yaml", read_text_file(options.camera));
  report.frames = static_cast<int>(poses.size());
  report.duration_s = poses.empty() ? 0 : poses.back().time_s;
  return report;
}

}  // namespace nadir
