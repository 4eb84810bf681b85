// What the autopilot's sensors tell instead of the truth: a compass that is off by a constant and by a deviation that
// turns with the course, a barometer that drifts, an attitude with a slowly changing bias, an accelerometer that is
// turned by that compass. One sigma of each in all is what the camera file states.
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
  std::optional<Eigen::Vector2d> imu_dv_mps;  // since the pose told before
};

// What an accelerometer without any error would tell of the way from one pose to the next.
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
    void advance(double seconds, Random& random);
  };

  double compass_error(double heading_rad) const;

  TelemetryUncertainty sigma_;
  Random random_;
  double heading_bias_;
  Eigen::Vector2d deviation_;  // coefficients B and C: of the sine and the cosine of the course
  GaussMarkov height_, pitch_, roll_;
  double last_s_ = -1;

  // The accelerometer, from a stream of its own.
  std::optional<Eigen::Vector2d> measure_velocity_change(const FlightPose& pose);
  Random imu_random_;
  GaussMarkov imu_east_, imu_north_;
  std::optional<FlightPose> last_pose_;
};

}  // namespace nadir
