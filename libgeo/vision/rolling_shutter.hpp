// Undoing a rolling shutter: the image as all its lines would have shown it at one moment, that of the middle line.
//
// A line that is exposed t after the middle one is seen from elsewhere. With the camera's turn ω (in its own axes) and
// velocity v held constant during the readout, R its attitude (world from camera) at the middle, r a ray with z = 1,
// and λ the length at which that ray meets level ground, the ground point of r appears in line t along the ray
//
//   r(t) = exp(-[ω]× t) (r - Rᵀ v t / λ)
//
// and t is that of the line in which r(t) lies: a fixed point, found in a few iterations. The turn needs no height;
// the relief of the ground changes the small second term by its share of the height, and is left out.
//
// At 25 m/s and 30 ms the lines of an image are up to 0.75 m apart; at 30 degrees a second they are turned by 0.9
// degrees, 1.6 m at the ground from 100 m.
#pragma once

#include <opencv2/core/mat.hpp>

#include "vision/camera.hpp"

namespace nadir {

struct ShutterMotion {
  Attitude attitude;  // of the camera, at the middle line
  double agl_m = 100;
  Eigen::Vector2d velocity_mps = Eigen::Vector2d::Zero();  // east, north
  // About image-up, image-right and the optical axis (Telemetry).
  Eigen::Vector3d rate_rad_s = Eigen::Vector3d::Zero();
};

// How an image was made of one that was read line after line.
struct UndoneShutter {
  SensorReadout readout;
  ShutterMotion motion;
};

// image: of the camera's size. Where it shows nothing of what the result should, at its edges, the nearest is repeated.
cv::Mat without_rolling_shutter(const cv::Mat& image, const CameraModel& camera, const SensorReadout& readout,
                                const ShutterMotion& motion);

// Where the image as it was read shows what the other shows at a pixel, and the inverse of that.
Eigen::Vector2d pixel_as_read(const Eigen::Vector2d& at_one_moment, const CameraModel& camera,
                              const SensorReadout& readout, const ShutterMotion& motion);
Eigen::Vector2d pixel_at_one_moment(const Eigen::Vector2d& as_read, const CameraModel& camera,
                                    const SensorReadout& readout, const ShutterMotion& motion);

// How long after the middle line a pixel's line was exposed.
double seconds_after_middle(const CameraModel& camera, const SensorReadout& readout, const Eigen::Vector2d& pixel);

// The rate in the camera frame: x to the right of the image, y down, z along the optical axis.
inline Eigen::Vector3d camera_frame_rate(const Eigen::Vector3d& rate_rad_s) {
  return {rate_rad_s.y(), -rate_rad_s.x(), rate_rad_s.z()};
}

}  // namespace nadir
