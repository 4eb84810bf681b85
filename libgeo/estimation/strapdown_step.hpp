// One step of strapdown navigation in the horizontal plane by a preintegrated motion, and how its errors move: the part
// of the flight filter's process model that belongs to the inertial sensor (equations in flight_filter.hpp).
//
// The gyroscopes measure (I + M) ω + b_g: M holds the errors of their scale (diagonal) and of their axes' angles. A
// turn of 90° with angles of half a percent makes an attitude error of half a degree, which no constant bias explains.
// Over a part of a second M acts as the further bias M ω, of the part's mean ω. The accelerometers' M is left out: in
// level flight it is a bias, and a bank changes that by a hundredth.
//
// Errors e = (φ, δb_g, δb_f, δM by columns): attitude (world from sensor, turned by Exp(φ), radians about east, north,
// up); the others in the sensor's axes, rad/s, m/s² and ratios.
#pragma once

#include "estimation/inertial_preintegration.hpp"

namespace nadir {

struct InertialCalibration {
  InertialBias bias;
  Eigen::Matrix3d rate_scale = Eigen::Matrix3d::Zero();  // M
};

struct StrapdownStep {
  static constexpr int kErrors = 18;
  enum Error { attitude_error = 0, rate_bias = 3, force_bias = 6, rate_scale = 9 };
  // Rows of what the step adds to, and of its noise.
  enum Row { position_east, position_north, velocity_east, velocity_north, heading, errors };
  static constexpr int kRows = errors + kErrors;
  using ErrorMatrix = Eigen::Matrix<double, kErrors, kErrors>;

  Eigen::Matrix3d world_from_sensor;  // after it
  // Position beyond velocity times time (m), velocity (m/s; east, north), heading of the sensor's first axis (radians,
  // clockwise).
  Eigen::Matrix<double, 5, 1> added;
  Eigen::Matrix<double, 5, kErrors> added_by_errors;  // G
  ErrorMatrix error_transition;                       // e' = A e
  Eigen::Matrix<double, kRows, kRows> noise;          // of both, in the order of Row
};

// before: world from sensor. preintegrated: whatever biases it removed; calibration: the nominal one. velocity_mps
// (east, north) and earth_rate_rad_s (east, north, up) make the Coriolis acceleration.
StrapdownStep strapdown_step(const Eigen::Matrix3d& before, const PreintegratedMotion& preintegrated,
                             const InertialCalibration& calibration, const Eigen::Vector2d& velocity_mps,
                             const Eigen::Vector3d& earth_rate_rad_s);

// The sensor's attitude when its camera has this one: heading of image-up, pitch and roll; and how errors of the three
// turn it (φ = T (δψ, δθ, δroll)).
Eigen::Matrix3d world_from_sensor(double heading_rad, double pitch_rad, double roll_rad);
Eigen::Vector3d camera_angles(const Eigen::Matrix3d& world_from_sensor);  // the inverse
Eigen::Matrix3d attitude_error_by_angles(double heading_rad);

}  // namespace nadir
