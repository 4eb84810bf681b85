// The camera: its lens, its telemetry's uncertainty, its attitude, and the aircraft that it is mounted on.
//
// Lens: pinhole with Brown-Conrady distortion, OpenCV's order of coefficients (k1 k2 p1 p2 k3). With x, y the point's
// coordinates at z = 1 and r² = x² + y²:
//   x' = x (1 + k1 r² + k2 r⁴ + k3 r⁶) + 2 p1 x y + p2 (r² + 2 x²)
//   y' = y (1 + k1 r² + k2 r⁴ + k3 r⁶) + p1 (r² + 2 y²) + 2 p2 x y        pixel = (fx x' + cx, fy y' + cy)
//
// Camera frame: x to the right of the image, y down the image, z along the optical axis (at nadir: down). Pixels are
// continuous with the centre of the top-left pixel at (0, 0), as in OpenCV's calibration.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "base/digest.hpp"
#include "base/time.hpp"
#include "vision/localizer_parameters.hpp"

namespace nadir {

class YamlNode;

struct CameraModel {
  int width = 0;   // pixels
  int height = 0;  // pixels
  double fx = 0;   // pixels
  double fy = 0;
  double cx = 0;
  double cy = 0;
  std::array<double, 5> distortion{};  // k1 k2 p1 p2 k3; zeros: none

  bool distorted() const { return distortion != std::array<double, 5>{}; }

  // Where a point given in the camera frame (z > 0) appears. Defined beyond the image's edge as well: where the lens'
  // polynomial would turn back, it continues straight, so that nothing outside appears inside.
  Eigen::Vector2d pixel_from_point(const Eigen::Vector3d& point) const;
  // The ray through a pixel, with z = 1. Inverts the distortion iteratively to below 1e-9.
  Eigen::Vector3d ray_from_pixel(const Eigen::Vector2d& pixel) const;

  // The same camera for images resampled by `factor` (0.5: half as wide).
  CameraModel scaled(double factor) const;
};

// One sigma of the telemetry that comes with this camera.
struct TelemetryUncertainty {
  double heading_rad = kDefaultHeadingSigma_rad;
  double agl_relative = kDefaultAglSigma;
  double tilt_rad = kDefaultTiltSigma_rad;
  double imu_dv_mps =
      kDefaultImuSigma_mps;  // of the change of velocity, per root second, biases of up to a minute included
};

// A sensor that is read line after line (a rolling shutter): its rows, or columns, show different moments. The time of
// a frame is that of the middle line. rolling_shutter.hpp.
struct SensorReadout {
  enum class Direction : std::uint8_t { down, up, right, left };  // over the image; down: the top row first

  double duration_s = 0;  // of all lines
  Direction direction = Direction::down;
};

std::string_view name_of(SensorReadout::Direction direction);

struct CameraFile {
  CameraModel camera;
  TelemetryUncertainty uncertainty;
  std::optional<SensorReadout> readout{};  // none: all lines at once
  bool on_gimbal = false;                  // it may look anywhere: frames without a measured tilt are not used

  // From one line to the next.
  double line_time_s() const;
};

// camera.yaml (docs/formats.md), and the same inside a larger document. Throw UsageError with file, line and column.
CameraFile read_camera_file(const std::filesystem::path& path);
CameraFile read_camera(const YamlNode& root);

// Attitude of a camera whose image-up direction is the aircraft's nose. Heading: of image-up, clockwise from true
// north. Pitch: positive when the nose is up, so that the optical axis looks ahead of nadir. Roll: positive with the
// right wing down, so that the axis looks to the left of nadir. Order as in aviation: yaw, pitch, roll.
struct Attitude {
  double heading_rad = 0;
  double pitch_rad = 0;
  double roll_rad = 0;
};

// Columns: the camera's x, y, z axes in east-north-up.
Eigen::Matrix3d enu_from_camera(const Attitude& attitude);

// A gimbal that carries the camera, by its GIMBAL_DEVICE_ATTITUDE_STATUS.
struct GimbalAddress {
  std::uint8_t component = 154;  // who sends it; MAV_COMP_ID_GIMBAL
  std::uint8_t device = 0;       // of several of one sender: 1 to 6 for those that an autopilot speaks for
};

// The aircraft: its camera, how that is mounted, and its identity on the MAVLink network. airframe.json
// (docs/formats/airframe.md), written by whoever provisions the aircraft.
// Of the autopilot, as provisioning left it.
struct AirframeParameter {
  std::string name;
  double value = 0;
};

// The model of a second matcher (network_plugin.hpp).
struct AirframeMatcher {
  std::string model;  // an ONNX file; relative to the folder of airframe.json
  Sha256 sha256;
};

struct Airframe {
  std::string id;
  CameraFile camera;
  // The camera's attitude in the aircraft: yaw of image-up against the nose, clockwise seen from above, then pitch and
  // roll as of an aircraft. Zeros: looks straight down, image-up to the nose.
  Attitude mount;
  double capture_delay_s = 0;    // from the exposure to the moment when the frame is delivered
  std::uint8_t system = 1;       // the aircraft's MAVLink system id
  std::uint8_t autopilot = 1;    // component id of the autopilot
  std::uint8_t component = 197;  // ours; MAV_COMP_ID_VISUAL_INERTIAL_ODOMETRY
  std::uint8_t link = 1;         // our link id in signatures
  std::uint8_t gps_id = 0;       // of GPS_INPUT
  // Sequence number of the aircraft's files, so that it accepts no earlier one. Files of an older format have
  // neither.
  std::optional<std::int64_t> sequence{};
  std::optional<UtcTime> expires{};
  std::vector<AirframeParameter> parameters{};  // compared before take-off
  std::optional<AirframeMatcher> matcher{};     // none: the first matcher is alone
  std::optional<GimbalAddress> gimbal{};        // then `mount` is the camera's on the gimbal that looks straight down
};

// Throw UsageError with file, line and column.
Airframe read_airframe(const std::filesystem::path& path);
Airframe parse_airframe(std::string_view text, std::string_view name);

// The camera's attitude when the aircraft has this one, and the inverse.
Attitude camera_attitude(const Attitude& aircraft, const Attitude& mount);
Attitude aircraft_attitude(const Attitude& camera, const Attitude& mount);

// The same of a camera on a gimbal. Columns of ned_from_gimbal: the gimbal's axes in north-east-down: ahead (the
// optical axis), right, down. mount: of the camera, when the gimbal looks straight down.
Attitude camera_attitude_on_gimbal(const Eigen::Matrix3d& ned_from_gimbal, const Attitude& mount);

// The turn of a camera about image-up, image-right and its optical axis (Telemetry::rate_rad_s): when the aircraft
// rolls, pitches and yaws so, in its own axes; and from one attitude to another.
Eigen::Vector3d camera_rate(const Eigen::Vector3d& aircraft_rad_s, const Attitude& mount);
Eigen::Vector3d camera_rate(const Attitude& before, const Attitude& after, double seconds);

}  // namespace nadir
