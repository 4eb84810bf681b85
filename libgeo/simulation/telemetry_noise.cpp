#include "simulation/telemetry_noise.hpp"

#include <algorithm>
#include <cmath>

namespace nadir {

void TelemetryNoise::Drift::advance(double seconds, Random& random) {
  const double keep = std::exp(-seconds / correlation_s);
  value = keep * value + std::sqrt(1 - keep * keep) * random.normal();
}

TelemetryNoise::TelemetryNoise(const TelemetryUncertainty& uncertainty, std::uint64_t seed)
    : sigma_(uncertainty), random_(Random(seed).fork("telemetry")) {
  heading_bias_ = 0.85 * sigma_.heading_rad * std::clamp(random_.normal(), -2.0, 2.0);
  height_ = {std::clamp(random_.normal(), -2.0, 2.0), 240};
  pitch_ = {std::clamp(random_.normal(), -2.0, 2.0), 90};
  roll_ = {std::clamp(random_.normal(), -2.0, 2.0), 90};
}

ToldPose TelemetryNoise::tell(const FlightPose& pose) {
  if (last_s_ >= 0) {
    for (Drift* drift : {&height_, &pitch_, &roll_}) drift->advance(pose.time_s - last_s_, random_);
  }
  last_s_ = pose.time_s;
  ToldPose told;
  told.time_s = pose.time_s;
  // Bias and noise add up to the stated sigma: 0.85² + 0.53² = 1, 0.95² + 0.31² = 1, 0.75² + 0.66² = 1.
  told.attitude.heading_rad = pose.attitude.heading_rad + heading_bias_ + 0.53 * sigma_.heading_rad * random_.normal();
  told.agl_m = pose.pressure_agl_m * (1 + sigma_.agl_relative * (0.95 * height_.value + 0.31 * random_.normal()));
  told.attitude.pitch_rad = pose.attitude.pitch_rad + sigma_.tilt_rad * (0.75 * pitch_.value + 0.66 * random_.normal());
  told.attitude.roll_rad = pose.attitude.roll_rad + sigma_.tilt_rad * (0.75 * roll_.value + 0.66 * random_.normal());
  return told;
}

}  // namespace nadir
