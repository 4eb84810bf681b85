// A MEMS inertial sensor on the simulated aircraft: what its gyroscopes and accelerometers say between two moments.
//
//   rate  = (I + M_g) ω + b_g + n_g        force = (I + M_f) f + b_f + n_f
//
// ω: mean turn rate of the body against inertial space, the Earth's included; f: mean specific force, v' - g + 2 ω_e × v.
// Both are the exact integrals over the sample, in the body's axes (forward, right, down). n: white noise. b: a constant, a
// Gauss-Markov process (bias instability) and a random walk. M: errors of scale and of the axes' angles, constant.
//
// Figures of a TDK InvenSense ICM-42688-P (datasheet DS-000347) after the autopilot's calibration: noise density
// 0.0028 deg/s/√Hz and 70 µg/√Hz; zero-rate drift with temperature 0.005 deg/s/K and 0.15 mg/K, of which 20 K make the
// constants together with what calibration leaves; scale and cross-axis errors of 0.5 %
// (limits: 0.5 % and 1.25 %). The datasheet states
// no bias instability: 8 deg/h and 40 µg are those of such sensors (Analog Devices ADIS16470: 8 deg/h and 13 µg).
#pragma once

#include <Eigen/Core>

#include "base/random.hpp"

namespace nadir {

struct MemsFigures {
  double rate_noise_rad_s = 4.9e-5, force_noise_mps2 = 6.9e-4;            // per √Hz
  double rate_bias_rad_s = 1.7e-3, force_bias_mps2 = 0.1;                 // constant; one σ, as are all of these
  double rate_instability_rad_s = 3.9e-5, force_instability_mps2 = 4e-4;  // of Gauss-Markov processes …
  double instability_s = 200;                                             // … of this correlation time
  double rate_walk_rad_s = 2e-6, force_walk_mps2 = 2e-4;                  // per √s
  double scale = 0.005;                                                   // of each element of M
};

// Where a body is and how it moves at a moment.
struct BodyMotion {
  double time_s = 0;
  Eigen::Matrix3d enu_from_body = Eigen::Matrix3d::Identity();
  Eigen::Vector3d velocity_mps = Eigen::Vector3d::Zero();  // east, north, up
};

struct MeasuredRates {
  double time_s = 0;  // end of the sample
  Eigen::Vector3d rate_rad_s, force_mps2;
};

class MemsImu {
 public:
  // exact: without any error.
  MemsImu(const MemsFigures& figures, double latitude_rad, Random random, bool exact = false);

  MeasuredRates measure(const BodyMotion& before, const BodyMotion& now);

 private:
  struct Sensor {
    Eigen::Matrix3d scale;
    Eigen::Vector3d constant, instability, walk;
  };
  Eigen::Vector3d with_errors(Sensor& sensor, const Eigen::Vector3d& exact, double dt, double noise,
                              double instability, double walk);

  MemsFigures figures_;
  Eigen::Vector3d earth_rate_rad_s_;
  Random random_;
  bool exact_;
  Sensor rate_, force_;
};

}  // namespace nadir
