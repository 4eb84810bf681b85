// What the autopilot knows at the moment of a picture. Everything but the time may be unknown.
#pragma once

#include <Eigen/Core>
#include <optional>
#include <string>
#include <vector>

#include "geodesy/lon_lat.hpp"

namespace nadir {

// A stretch of the way at whose end there was no picture.
struct TelemetryInterval {
  double seconds = 0;
  std::optional<double> heading_rad;          // at its end; as in Telemetry
  std::optional<Eigen::Vector2d> imu_dv_mps;  // over it; as in Telemetry
};

struct Telemetry {
  std::string frame;  // file name of the picture
  double time_s = 0;
  std::optional<double> agl_m;        // height above ground
  std::optional<double> heading_rad;  // of image-up, clockwise from true north
  std::optional<double> pitch_rad;    // see vision/camera_model.hpp for the signs
  std::optional<double> roll_rad;
  // What was told between the last telemetry and this one, in order, where that is long: two opposite turns leave no
  // trace in what is true at both ends. The stretches end before time_s.
  std::vector<TelemetryInterval> way;
  // Change of velocity since the last telemetry, or since the end of the way, east and north (m/s): the
  // accelerometer's, gravity removed, turned by the autopilot's attitude. Who leaves frames out adds theirs up.
  std::optional<Eigen::Vector2d> imu_dv_mps;
  std::optional<LonLat> place;  // if some other source knows it; never used by the localizer as truth
};

}  // namespace nadir
