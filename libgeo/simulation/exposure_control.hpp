// How light and exposure wander during a flight, and how far the ground moves over the picture while the shutter is
// open: what CameraSensor needs to know about each frame.
#pragma once

#include <cstdint>

#include "simulation/camera_sensor.hpp"
#include "simulation/flight_path.hpp"
#include "simulation/noise.hpp"
#include "vision/camera.hpp"

namespace nadir {

enum class SensorNoise { none, real };

class ExposureControl {
 public:
  ExposureControl(const CameraModel& camera, std::uint64_t seed);

  // pose.agl_m must be positive.
  Exposure of(const FlightPose& pose, std::uint64_t frame) const;

 private:
  CameraModel camera_;
  std::uint64_t seed_;
  Noise light_;
};

}  // namespace nadir
