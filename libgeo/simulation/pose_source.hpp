// Where a simulated camera is, as somebody outside tells it: an autopilot's simulator over MAVLink, or a test's script.
#pragma once

#include <Eigen/Core>
#include <chrono>
#include <cstdint>
#include <optional>

#include "geodesy/lon_lat.hpp"
#include "vision/camera_model.hpp"

namespace nadir {

struct LivePose {
  std::int64_t unix_us = 0;  // when it was there: UTC, microseconds since 1970
  LonLat place{};
  double height_m = 0;  // as the elevation model counts heights
  Attitude attitude{};
  Eigen::Vector3d velocity_enu_mps = Eigen::Vector3d::Zero();
};

class PoseSource {
 public:
  virtual ~PoseSource() = default;

  // The newest pose, if it was not given before; older ones are dropped. Waits at most so long for one to come.
  virtual std::optional<LivePose> newest(std::chrono::milliseconds patience) = 0;
};

}  // namespace nadir
