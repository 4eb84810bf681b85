// How the camera sits in the aircraft, from a flight during which GPS was good: pictures were found on the map, GPS
// says where the aircraft was, the autopilot how it lay. What is left between them in all frames alike is the mount.
//
// Least squares over seven numbers: yaw, pitch and roll of the mount, what is missing of the capture delay, the common
// offset of GPS and map (east, north), and a factor on the height. A pitch looks like an offset ahead of the aircraft;
// only headings that differ tell it from GPS's offset, and only speeds and turns that differ tell it from a delay. So
// every result comes with its sigma, and a delay that the flight does not show stays as it was told.
//
// A constant error of the compass is part of the yaw: the two cannot be told apart.
#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "base/finding.hpp"
#include "vision/camera.hpp"

namespace nadir {

// One frame. Position in the map's plane (m), angles in radians.
struct BoresightSight {
  double time_s = 0;
  Eigen::Vector2d gps_m = Eigen::Vector2d::Zero();         // east, north
  Eigen::Vector2d velocity_mps = Eigen::Vector2d::Zero();  // of it
  Attitude aircraft;
  Attitude rate_rad_s;  // how each of its angles changes
  // What the picture says against the map: (east, north, log of true over told height, heading, pitch, roll) of the
  // camera.
  Eigen::Matrix<double, 6, 1> seen = Eigen::Matrix<double, 6, 1>::Zero();
  Eigen::Matrix<double, 6, 6> covariance = Eigen::Matrix<double, 6, 6>::Identity();
};

struct BoresightSettings {
  Attitude mount;                    // to begin with
  TelemetryUncertainty uncertainty;  // of attitude and height, one sigma
  double gps_sigma_m = 1.5;          // one axis, what changes within minutes
  double offset_sigma_m = 4;         // one axis, what GPS and map are apart all the time
};

struct Boresight {
  Attitude mount, mount_sigma;
  double delay_s = 0;  // to be added to the capture delay
  double delay_sigma_s = 0;
  bool delay_seen = false;  // else it is as it was told
  Eigen::Vector2d offset_m = Eigen::Vector2d::Zero();
  double height_factor = 1;
  std::size_t used = 0, set_aside = 0;  // frames
  double misfit = 0;                    // mean squared residual in sigmas; about 1 or below when all is as assumed
};

// sights: in the order of time. Nothing for fewer than three.
std::optional<Boresight> solve_boresight(const std::vector<BoresightSight>& sights, const BoresightSettings& settings);

struct BoresightLimits {
  std::size_t min_frames = 20;
  double max_tilt_sigma_deg = 1;
  double max_yaw_sigma_deg = 3;
};

// Findings: provision.few_anchors, provision.boresight_unsure, provision.boresight_misfit, provision.boresight_range.
Findings check_boresight(const std::optional<Boresight>& boresight, const BoresightLimits& limits);

}  // namespace nadir
