// A flat world and a camera over it, made without the code under test: the ray caster has its own rotation, its own
// inverse of the lens and its own intersection, so that it can serve as an oracle.
#pragma once

#include <cstdint>
#include <functional>
#include <opencv2/core/mat.hpp>

#include "imagery/map_window.hpp"
#include "vision/rectification.hpp"

namespace nadir::test {

// Grey level (0-255) of a place on the ground.
using Ground = std::function<double(PlanePoint)>;

// Waves of a few wavelengths from 10 to 60 m: smooth, so that what resampling adds stays small and can be bounded.
double waves(PlanePoint place);

// Parcels, hedges, roads and roofs around (0, 0), seeded. Outside of the square of ±half_side_m: 128.
class Landscape {
 public:
  Landscape(std::uint64_t seed, double half_side_m, double gsd_m = 0.5);

  double grey(PlanePoint place) const;  // bilinear
  Ground ground() const {
    return [this](PlanePoint place) { return grey(place); };
  }
  double half_side_m() const { return half_side_m_; }
  double gsd_m() const { return gsd_m_; }
  // The same picture with other contrast and light: what a map looks like to a camera of another season.
  MapWindow map(double gsd_m, bool reversed = false) const;

 private:
  double half_side_m_;
  double gsd_m_;
  cv::Mat image_;  // CV_32FC1, row 0 in the north
};

// What a pixel sees: yaw, pitch, roll by axis and angle, Newton for the lens, a ray and a plane.
PlanePoint seen_by_pixel(const CameraModel& camera, const CameraPose& pose, double x, double y);

// CV_8UC1 of the camera's size; `samples` by `samples` rays a pixel.
cv::Mat photograph(const Ground& ground, const CameraModel& camera, const CameraPose& pose, int samples = 1);

// The same of a camera that moves: each pixel from where the camera is when it is read.
cv::Mat photograph_moving(const Ground& ground, const CameraModel& camera,
                          const std::function<CameraPose(int x, int y)>& pose_at_pixel);
// Seconds after the middle row of a rolling shutter that reads row after row, from the top.
double row_seconds(const CameraModel& camera, double readout_s, int y);

// A camera of 320 x 240 pixels that sees 80 degrees across.
CameraModel small_camera();
CameraModel bent_camera();  // the same with a distorted lens

// CV_32FC2: a picture whose values are its own pixel coordinates. Rectified, it tells where each pixel was taken from.
cv::Mat coordinates(const CameraModel& camera);

}  // namespace nadir::test
