// A whole simulated flight on disk: frames/*.jpg, telemetry.csv, truth.csv and a copy of the camera's file, as
// `nadir replay` reads them. docs/commands/simulate-flight.md.
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>

#include "base/progress.hpp"
#include "package/mission.hpp"
#include "simulation/camera_sensor.hpp"

namespace nadir {

struct SimulatedFlightOptions {
  std::filesystem::path world;
  std::optional<std::filesystem::path> dem;  // none: flat ground at the mission's height
  std::filesystem::path camera;
  std::uint64_t seed = 1;
  SensorNoise noise = SensorNoise::real;
  std::optional<int> max_frames;
  std::optional<double> interval_s;
  double speed_mps = 22;
  int imu_hz = 0;  // samples of an inertial sensor (mems_imu.hpp) a second: imu.csv; 0: none
};

struct FlightReport {
  int frames = 0;
  int frames_beyond_world = 0;  // that show ground without map pixels somewhere
  double length_m = 0;
  double duration_s = 0;
  double interval_s = 0;
};

// Fills `folder`, which must exist. The same inputs give the same bytes.
FlightReport simulate_flight(const Mission& mission, const SimulatedFlightOptions& options,
                             const std::filesystem::path& folder, Progress& progress);

}  // namespace nadir
