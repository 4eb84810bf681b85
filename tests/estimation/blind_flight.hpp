// Flights of a simulated fixed wing with a MEMS inertial sensor whose camera goes blind, without pictures: what
// telemetry, odometry and anchors would say until then, and where the flight filter takes the aircraft to be at the
// end.
#pragma once

#include "estimation/drawn_flight.hpp"
#include "simulation/mems_imu.hpp"

namespace nadir::test {

struct BlindOptions {
  int seen_s = 150;  // with odometry each second and an anchor every ten, and four turns
  int blind_s = 60;
  int turns = 0;  // 0; 1; 2, of which the second goes back; 90° each
  bool imu = true;
  double turn_sign = 1;
  std::size_t rate_hz = 100;
  MemsFigures figures;
  double mount_sigma_rad = 0.0175;  // of the sensor's axes to the camera's
  TelemetryUncertainty uncertainty = {0.05, 0.04, 0.015, 0.3};
  // Called with the samples of each second, which it may spoil.
  std::function<void(int second, std::vector<InertialSample>&)> spoil;
};

struct BlindEnd {
  double error_m = 0, sigma_m = 0, nees = 0;
  double velocity_error_mps = 0;
  bool inertial = false;    // at the end
  double largest_chi2 = 0;  // of what odometry said, against the inertial prediction
  int contradicted = 0;     // such motions beyond the gate
  FlightFilter fresh;       // before the first step
  FlightFilter filter;      // at the end
  std::vector<FlightStep> steps;
  std::vector<Eigen::Vector2d> truth_m;
};

BlindEnd fly_blind(Random random, const BlindOptions& options);

// To whole mrad/s and mg, as ArduPilot's RAW_IMU is.
void round_as_raw_imu(int second, std::vector<InertialSample>& samples);

}  // namespace nadir::test
