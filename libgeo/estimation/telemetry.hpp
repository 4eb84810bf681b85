// What the autopilot measured at the moment of a frame. Everything but the time may be unknown.
#pragma once

#include <Eigen/Core>
#include <optional>
#include <string>
#include <vector>

#include "estimation/inertial_preintegration.hpp"
#include "geodesy/lon_lat.hpp"

namespace nadir {

// A part of the time between two frames, at whose end there is no frame.
struct TelemetryInterval {
  double seconds = 0;
  std::optional<double> heading_rad;          // at its end; as in Telemetry
  std::optional<Eigen::Vector2d> imu_dv_mps;  // over it; as in Telemetry
};

struct Telemetry {
  std::string frame;  // file name of the image
  double time_s = 0;
  std::optional<double> agl_m;        // height above ground
  std::optional<double> heading_rad;  // of image-up, clockwise from true north
  std::optional<double> pitch_rad;    // see vision/camera.hpp for the signs
  std::optional<double> roll_rad;
  // What was measured between the last telemetry and this one, in order, where that is long: two opposite turns cannot
  // be seen from the values at both ends. The intervals end before time_s.
  std::vector<TelemetryInterval> intervals;
  // Change of velocity since the last telemetry, or since the last interval, east and north (m/s): the accelerometer's,
  // gravity removed, rotated by the autopilot's attitude. A caller that skips frames must sum theirs up.
  std::optional<Eigen::Vector2d> imu_dv_mps;
  std::optional<LonLat> gps_position;  // if any; the localizer never uses it
  // Turn of the camera about image-up, image-right and the optical axis (rolling, pitching, yawing), for a rolling
  // shutter alone.
  std::optional<Eigen::Vector3d> rate_rad_s{};
  // Of an inertial sensor that turns with the camera, since the last telemetry and up to time_s, in order of time
  // (inertial_preintegration.hpp: image-up, image-right, optical axis). With these, intervals and imu_dv_mps do not
  // count. A caller that skips frames must keep theirs.
  std::vector<InertialSample> inertial{};
};

// Implausible values become unknown: NaN, heights below 1 m or above 30 km, absurd angles and accelerations, intervals
// longer than the time between the frames; of inertial samples only the usable ones are left. An autopilot's NaN must
// not reach the filter, which would keep it for ever. A time that is not finite becomes last_time_s.
Telemetry plausible_telemetry(Telemetry telemetry, double last_time_s);

}  // namespace nadir
