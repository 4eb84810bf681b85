// A checkerboard as a known camera shows it: every pixel asks its rays where they meet the board. Nothing of OpenCV's
// calibration is in it.
#pragma once

#include <filesystem>
#include <opencv2/core/mat.hpp>

#include "vision/camera.hpp"

namespace nadir::test {

// Where the board is: turned about its middle (radians: about its x and y axis, and in its plane), the middle seen at a
// pixel, at a distance along the optical axis.
struct BoardPose {
  double tilt_x_rad = 0;
  double tilt_y_rad = 0;
  double turn_rad = 0;
  Eigen::Vector2d middle_px{0, 0};
  double depth_m = 0.5;
};

class BoardScene {
 public:
  // 9 x 6 inner corners of 25 mm.
  explicit BoardScene(const CameraModel& camera);

  // CV_8UC1. blur_px: sigma of a lens out of focus. seed: of the sensor's noise.
  cv::Mat picture(const BoardPose& pose, double blur_px, unsigned seed) const;

 private:
  CameraModel camera_;
  std::vector<Eigen::Vector3d> rays_;  // of 3 x 3 points in each pixel
};

CameraModel test_camera();

// Twelve poses that reach all edges, tilted both ways.
std::vector<BoardPose> good_poses(const CameraModel& camera);

// Where the inner corners are seen, row by row.
std::vector<cv::Point2f> true_corners(const CameraModel& camera, const BoardPose& pose);

// Writes them as 00.png, 01.png, ….
void write_pictures(const std::filesystem::path& folder, const CameraModel& camera, const std::vector<BoardPose>& poses,
                    double blur_px);

}  // namespace nadir::test
