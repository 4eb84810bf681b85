// Boresight: how the camera is mounted in the aircraft, from a flight with good GPS. Each frame is matched with the map
// by itself, beginning at GPS's position; GPS gives the aircraft's position, the autopilot its attitude. What remains
// between them in all frames alike is the mount. No filter is in between, which would carry one frame's error into the
// next.
//
// Robust least squares over seven unknowns, solved by Ceres: yaw, pitch and roll of the mount, the missing part of the
// capture delay d, the common offset (e, n) between GPS and map, and the logarithm h of a factor on the height. The
// prediction of one frame is
//   position = gps - velocity d + (e, n)
//   log(true / stated height) = h
//   attitude = mount composed with (aircraft attitude - rate d)
// A pitch looks like an offset ahead of the aircraft; only different headings separate it from GPS's offset, and only
// different speeds and turns from a delay. So every result comes with its sigma, and a delay that the flight does not
// make observable stays as stated. A constant compass error is part of the yaw: the two are not separable.
#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "base/error.hpp"
#include "base/progress.hpp"
#include "geodesy/plane_point.hpp"
#include "package/open_package.hpp"
#include "provision/gyro_delay.hpp"
#include "replay/flight_folder.hpp"
#include "vision/camera.hpp"

namespace nadir {

// One frame. Position in the map's plane (m), angles in radians.
struct BoresightMeasurement {
  double time_s = 0;
  PlanePoint gps_position;
  Eigen::Vector2d velocity_mps = Eigen::Vector2d::Zero();  // of the GPS position
  Attitude aircraft;
  Attitude rate_rad_s;  // rate of each of its angles
  // The frame matched with the map: (east, north, log of true over stated height, heading, pitch, roll) of the camera.
  Eigen::Matrix<double, 6, 1> seen = Eigen::Matrix<double, 6, 1>::Zero();
  Eigen::Matrix<double, 6, 6> covariance = Eigen::Matrix<double, 6, 6>::Identity();
};

struct BoresightSettings {
  Attitude mount;                    // initial value
  TelemetryUncertainty uncertainty;  // of attitude and height, one sigma
  double gps_sigma_m = 1.5;          // per axis, the part that varies within minutes
  double offset_sigma_m = 4;         // per axis, the constant part
  std::optional<GyroDelay> gyro_delay{};
};

struct Boresight {
  Attitude mount, mount_sigma;
  double delay_s = 0;  // to be added to the capture delay
  double delay_sigma_s = 0;
  bool delay_observable = false;  // else it stays as stated
  Eigen::Vector2d offset_m = Eigen::Vector2d::Zero();
  double height_factor = 1;
  std::size_t used = 0, outliers = 0;  // frames
  double misfit = 0;                   // mean squared residual in sigmas; about 1 or less when the assumptions hold
};

// measurements: in the order of time. nullopt for fewer than three.
std::optional<Boresight> solve_boresight(const std::vector<BoresightMeasurement>& measurements,
                                         const BoresightSettings& settings);

struct BoresightLimits {
  std::size_t min_frames = 20;
  double max_tilt_sigma_deg = 1;
  double max_yaw_sigma_deg = 3;
};

// Findings: provision.few_anchors, provision.boresight_unsure, provision.boresight_misfit, provision.boresight_range.
Findings check_boresight(const std::optional<Boresight>& boresight, const BoresightLimits& limits);

struct BoresightFlight {
  const Flight& flight;    // frames with GPS positions; the attitudes are those of a camera with …
  Attitude assumed_mount;  // … this mount; zeros: they are the aircraft's own
  std::size_t most_frames = 150;
};

struct BoresightMeasurements {
  std::vector<BoresightMeasurement> measurements;
  std::size_t frames = 0;  // complete frames that were matched, evenly chosen
};

// mount: the expected mount; the search covers up to some ten degrees around it.
BoresightMeasurements measure_boresight(const BoresightFlight& from, const CameraFile& camera, const Attitude& mount,
                                        const OpenPackage& package, Progress& progress);

}  // namespace nadir
