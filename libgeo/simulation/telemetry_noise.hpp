// What the autopilot's sensors tell instead of the truth: a compass that is off by a constant, a barometer that drifts,
// an attitude with a slowly changing bias. One sigma of each in all is what the camera file states.
#pragma once

#include <cstdint>

#include "base/random.hpp"
#include "simulation/flight_path.hpp"

namespace nadir {

struct ToldPose {
  double time_s = 0;
  double agl_m = 0;
  Attitude attitude;
};

class TelemetryNoise {
 public:
  TelemetryNoise(const TelemetryUncertainty& uncertainty, std::uint64_t seed);

  // Frames in the order of time.
  ToldPose tell(const FlightPose& pose);

 private:
  // A first-order Gauss-Markov process of unit variance.
  struct Drift {
    double value = 0;
    double correlation_s = 60;
    void advance(double seconds, Random& random);
  };

  TelemetryUncertainty sigma_;
  Random random_;
  double heading_bias_;
  Drift height_, pitch_, roll_;
  double last_s_ = -1;
};

}  // namespace nadir
