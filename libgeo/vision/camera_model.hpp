// The camera: pinhole with Brown–Conrady distortion, OpenCV's order of coefficients (k1 k2 p1 p2 k3).
//
// Camera frame: x to the right of the image, y down the image, z along the optical axis (at nadir: down). Pixels are
// continuous with the centre of the top-left pixel at (0, 0), as in OpenCV's calibration.
#pragma once

#include <Eigen/Core>
#include <array>
#include <filesystem>
#include <optional>

namespace nadir {

struct CameraModel {
  int width = 0;   // pixels
  int height = 0;  // pixels
  double fx = 0;   // pixels
  double fy = 0;
  double cx = 0;
  double cy = 0;
  std::array<double, 5> distortion{};  // k1 k2 p1 p2 k3; zeros: none

  bool distorted() const { return distortion != std::array<double, 5>{}; }

  // Where a point given in the camera frame (z > 0) appears. Defined beyond the picture's edge as well: where the lens'
  // polynomial would turn back, it goes straight on, so that nothing outside appears inside.
  Eigen::Vector2d pixel_from_point(const Eigen::Vector3d& point) const;
  // The ray through a pixel, with z = 1. Inverts the distortion iteratively to below 1e-9.
  Eigen::Vector3d ray_from_pixel(const Eigen::Vector2d& pixel) const;

  // The same camera for pictures resampled by `factor` (0.5: half as wide).
  CameraModel scaled(double factor) const;
};

// One sigma of the telemetry that comes with this camera.
struct TelemetryUncertainty {
  double heading_rad = 0.05;
  double agl_relative = 0.05;
  double tilt_rad = 0.05;
  double imu_dv_mps = 0.3;  // of the change of velocity, per root second, biases of up to a minute included
};

struct CameraFile {
  CameraModel camera;
  TelemetryUncertainty uncertainty;
};

// camera.yaml (docs/formats.md). Throws UsageError with file, line and column.
CameraFile read_camera_file(const std::filesystem::path& path);

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

}  // namespace nadir
