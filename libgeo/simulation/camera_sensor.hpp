// What lens, shutter and sensor do to an image: motion blur, vignetting, exposure, colour, noise.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <opencv2/core/mat.hpp>
#include <vector>

#include "simulation/flight_path.hpp"
#include "simulation/noise.hpp"
#include "vision/camera.hpp"

namespace nadir {

struct Exposure {
  Eigen::Vector2d motion_px = Eigen::Vector2d::Zero();  // while the shutter is open
  double gain = 1;                                      // relative to a well exposed image
  double warmth = 0;                                    // colour temperature, −1…1
};

class CameraSensor {
 public:
  CameraSensor(cv::Size size, double focal_px, std::uint64_t seed);

  void expose(cv::Mat& bgr, const Exposure& exposure, std::uint64_t frame) const;

 private:
  cv::Mat_<float> vignette_;
  std::vector<float> normal_;  // a table of normally distributed numbers
  std::uint64_t seed_;
};

enum class SensorNoise { none, real };

// How light and exposure vary during a flight, and how far the ground moves in the image while the shutter is open: the
// input of CameraSensor for each frame.
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
