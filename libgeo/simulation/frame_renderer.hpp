// The image of a world from a camera pose: a ray for every sixteenth pixel is intersected with the ground, pixels in
// between are interpolated, and the matching pyramid level is resampled. Exact at the nodes, to a few thousandths of a
// pixel between them over gentle terrain.
#pragma once

#include "simulation/world_raster.hpp"
#include "vision/camera.hpp"

namespace nadir {

struct RenderedFrame {
  cv::Mat image;                // CV_8UC3
  double covered_fraction = 1;  // of the image that lies on the world's valid pixels
};

class FrameRenderer {
 public:
  // Both must outlive the renderer.
  FrameRenderer(const CameraModel& camera, const WorldRaster& world, const GroundShape& ground);

  RenderedFrame render(const Eigen::Vector3d& position, const Attitude& attitude) const;

 private:
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
