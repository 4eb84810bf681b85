// How well odometry measures a turn: its change of heading against the truth. docs/benchmarks.md.
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <array>
#include <cmath>
#include <iostream>
#include <opencv2/imgproc.hpp>

#include "estimation/visual_odometry.hpp"
#include "geodesy/angles.hpp"
#include "safety_camera.hpp"
#include "safety_world.hpp"
#include "simulation/camera_sensor.hpp"
#include "simulation/flight_path.hpp"

using namespace nadir;
using namespace nadir::bench;

namespace {

constexpr double kAgl_m = 200, kSpeed_mps = 20;
constexpr int kFrames = 150;

struct Turns {
  double up_to_rad;
  double count = 0, error2 = 0, claimed2 = 0, normalised = 0;

  void add(double error_rad, double variance_rad2) {
    count += 1;
    error2 += error_rad * error_rad;
    claimed2 += variance_rad2;
    normalised += error_rad * error_rad / variance_rad2;
  }
};

// Parallel rows with two 90 degree turns per row: half of the frames are in turns.
std::vector<FlightPose> path_of(double interval_s, std::uint64_t seed) {
  FlightPathOptions options;
  options.agl_m = kAgl_m;
  options.speed_mps = kSpeed_mps;
  options.max_frames = kFrames;
  options.interval_s = interval_s;
  const double leg_m = std::min(900.0, 750 * interval_s + 250);
  PlanePath route;
  for (int row = 0; row < 7; ++row) {
    const double side = row % 2 == 0 ? -0.5 : 0.5;
    for (const double end : {side, -side}) route.push_back({end * leg_m, (row - 3) * 150.0});
  }
  return simulate_flight_path(route, GroundShape(), options, seed);
}

// The attitude has an autopilot's accuracy, the heading is exact: its error is that of odometry.
void fly(double interval_s, double tilt_rad, std::uint64_t seed, std::array<Turns, 3>& turns) {
  const World world(seed);
  const CameraFile file = camera_file();
  const Photographer photographer(file.camera);
  const CameraSensor sensor({file.camera.width, file.camera.height}, file.camera.fx, seed);
  const auto odometry = make_feature_odometry();
  Random random = Random(seed).fork("tilt");
  const Eigen::Vector2d constant(random.normal(0, tilt_rad), random.normal(0, tilt_rad));
  double last_heading_rad = 0;
  std::uint64_t number = 0;
  for (const FlightPose& pose : path_of(interval_s, seed)) {
    cv::Mat picture =
        photographer.photograph(world, {{pose.position.x(), pose.position.y()}, pose.agl_m, pose.attitude});
    sensor.expose(picture, Exposure(), number++);
    OdometryFrame frame;
    cv::cvtColor(picture, frame.grey, cv::COLOR_BGR2GRAY);
    frame.camera = file.camera;
    frame.attitude = pose.attitude;
    frame.attitude.pitch_rad += 0.7 * (constant.x() + random.normal(0, tilt_rad));
    frame.attitude.roll_rad += 0.7 * (constant.y() + random.normal(0, tilt_rad));
    frame.agl_m = pose.agl_m * 1.02;
    frame.linearization_point.heading_rad = pose.attitude.heading_rad;
    frame.tilt_sigma_rad = tilt_rad;
    frame.boresight_covariance_rad2 = 0.5 * tilt_rad * tilt_rad * Eigen::Matrix2d::Identity();
    frame.relief_sigma_m = 4;
    const double turn_rad = std::abs(wrap_pi(pose.attitude.heading_rad - last_heading_rad));
    last_heading_rad = pose.attitude.heading_rad;
    const auto step = odometry->track(frame);
    if (!step) continue;
    for (Turns& some : turns) {
      if (turn_rad > some.up_to_rad) continue;
      some.add(wrap_pi(step->measurement.value[3]), step->measurement.covariance(3, 3));
      break;
    }
  }
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App app("Errors of odometry in turns.", "turns");
  int flights = 4;
  double tilt_deg = 0.8;
  app.add_option("--flights", flights, "over a world each")->check(CLI::Range(1, 1000))->capture_default_str();
  app.add_option("--tilt-deg", tilt_deg, "one sigma of what the attitude is off by")
      ->check(CLI::Range(0.1, 5.0))
      ->capture_default_str();
  CLI11_PARSE(app, argc, argv);
  std::cout << "| s between frames | turned | frames | off by, rms | claimed | normalised error (1 is right) |\n"
            << "|---|---|---|---|---|---|\n";
  for (const double interval_s : {1.0 / 3, 1.2}) {
    std::array<Turns, 3> turns{Turns{radians(1)}, Turns{radians(4)}, Turns{radians(60)}};
    for (int flight = 1; flight <= flights; ++flight) {
      fly(interval_s, radians(tilt_deg), static_cast<std::uint64_t>(flight), turns);
    }
    double from_rad = 0;
    for (const Turns& some : turns) {
      std::cout << fmt::format("| {:.2f} | {:.0f}° to {:.0f}° | {} | {:.3f}° | {:.3f}° | {:.2f} |\n", interval_s,
                               degrees(from_rad), degrees(some.up_to_rad), some.count,
                               degrees(std::sqrt(some.error2 / some.count)),
                               degrees(std::sqrt(some.claimed2 / some.count)), some.normalised / some.count);
      from_rad = some.up_to_rad;
    }
  }
}
