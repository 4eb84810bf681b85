// The image of a world from a camera pose: a ray for every sixteenth pixel is intersected with the ground, pixels in
// between are interpolated, and the matching pyramid level is resampled. Exact at the nodes, to a few thousandths of a
// pixel between them over gentle terrain. With a rolling shutter each node is seen from where the camera is when the
// node's line is exposed.
#pragma once

#include <functional>

#include "simulation/world_raster.hpp"
#include "vision/camera.hpp"

namespace nadir {

struct RenderedFrame {
  cv::Mat image;                // CV_8UC3
  double covered_fraction = 1;  // of the image that lies on the world's valid pixels
};

// Where the camera is, and its axes in the world.
struct CameraPlace {
  Eigen::Vector3d position;
  Eigen::Matrix3d world_from_camera;
};

class FrameRenderer {
 public:
  // Both must outlive the renderer.
  FrameRenderer(const CameraModel& camera, const WorldRaster& world, const GroundShape& ground);

  RenderedFrame render(const Eigen::Vector3d& position, const Attitude& attitude) const;
  // at: so many seconds after the middle line.
  RenderedFrame render(const SensorReadout& readout, const std::function<CameraPlace(double seconds)>& at) const;

 private:
  RenderedFrame resampled(std::vector<Eigen::Vector3d> points) const;  // at the nodes, in the world

  CameraModel camera_;
  const WorldRaster& world_;
  const GroundShape& ground_;
  cv::Size nodes_;
  std::vector<Eigen::Vector3d> rays_;  // of the nodes, in the camera frame
};

// Where a ray from `position` along `direction` first hits the ground; far away but finite when it misses.
Eigen::Vector3d intersect_ground(const GroundShape& ground, const Eigen::Vector3d& position,
                                 const Eigen::Vector3d& direction);

}  // namespace nadir
