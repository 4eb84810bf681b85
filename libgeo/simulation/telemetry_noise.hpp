// Error model of the autopilot's telemetry. With n white noise of unit variance, g a Gauss-Markov process of unit
// variance, and sigma the 1-σ error of each quantity that the camera file states:
//
//   heading  psi + b + B sin psi + C cos psi + 0.53 sigma n    b, B, C drawn once: 0.6 sigma each
//   height   h (1 + sigma (0.95 g + 0.31 n))                   g: 240 s
//   tilt     theta + sigma (0.75 g + 0.66 n)                   g: 90 s
//   dv       R(heading error) dv + bias dt + 0.6 sigma sqrt(dt) n    bias: 0.8 sigma / sqrt(60 s) g, g: 300 s
#pragma once

#include <cstdint>
#include <optional>

#include "base/random.hpp"
#include "simulation/flight_path.hpp"

namespace nadir {

struct MeasuredPose {
  double time_s = 0;
  double agl_m = 0;
  Attitude attitude;
  std::optional<Eigen::Vector2d> imu_dv_mps;  // since the previous pose
};

// The velocity change from one pose to the next, as an accelerometer without errors measures it.
std::optional<Eigen::Vector2d> velocity_change(const std::optional<FlightPose>& before, const FlightPose& pose);

class TelemetryNoise {
 public:
  TelemetryNoise(const TelemetryUncertainty& uncertainty, std::uint64_t seed);

  // Frames in the order of time.
  MeasuredPose measure(const FlightPose& pose);

 private:
  // A first-order Gauss-Markov process of unit variance.
  struct GaussMarkov {
    double value = 0;
    double correlation_s = 60;
    void propagate(double seconds, Random& random);
  };

  double compass_error(double heading_rad) const;

  TelemetryUncertainty sigma_;
  Random random_;
  double heading_bias_;
  Eigen::Vector2d deviation_;  // coefficients B and C: of the sine and the cosine of the course
  GaussMarkov height_, pitch_, roll_;
  double last_s_ = -1;

  // The accelerometer has its own random stream.
  std::optional<Eigen::Vector2d> measure_velocity_change(const FlightPose& pose);
  Random imu_random_;
  GaussMarkov imu_east_, imu_north_;
  std::optional<FlightPose> last_pose_;
};

}  // namespace nadir
