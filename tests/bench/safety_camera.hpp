// The bench's camera over a world in memory, and the faults of its frames.
#pragma once

#include "base/random.hpp"
#include "safety_world.hpp"
#include "vision/rectification.hpp"

namespace nadir::bench {

// Small, so that an attempt is cheap: 320 x 240 pixels, 65 degrees across, a mild barrel; telemetry of a light
// drone.
CameraFile camera_file();

class Photographer {
 public:
  explicit Photographer(const CameraModel& camera);
  // Intersects every pixel's ray with the terrain; BGR, without sensor noise.
  cv::Mat photograph(const World& world, const CameraPose& pose) const;
  // Of any image of the ground; its middle is (0, 0).
  cv::Mat photograph(const cv::Mat& ground, double gsd_m, const GroundSurface& surface, const CameraPose& pose) const;

 private:
  CameraModel camera_;
  std::vector<Eigen::Vector3d> rays_;  // of every pixel, in the camera frame
};

void add_clouds(cv::Mat& bgr, double share, Random& random);
void make_night(cv::Mat& bgr, Random& random);

}  // namespace nadir::bench
