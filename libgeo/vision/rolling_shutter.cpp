#include "vision/rolling_shutter.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <opencv2/imgproc.hpp>

#include "vision/rectification.hpp"

namespace nadir {
namespace {

// exp(-[ω]× t)
Eigen::Matrix3d turned_back(const Eigen::Vector3d& rate_rad_s, double seconds) {
  const double angle_rad = rate_rad_s.norm() * seconds;
  if (angle_rad == 0) return Eigen::Matrix3d::Identity();
  return Eigen::AngleAxisd(-angle_rad, rate_rad_s.normalized()).toRotationMatrix();
}

}  // namespace

double seconds_after_middle(const CameraModel& camera, const SensorReadout& readout, const Eigen::Vector2d& pixel) {
  const double from_top = (pixel.y() + 0.5) / camera.height - 0.5, from_left = (pixel.x() + 0.5) / camera.width - 0.5;
  switch (readout.direction) {
    case SensorReadout::Direction::down: return readout.duration_s * from_top;
    case SensorReadout::Direction::up: return -readout.duration_s * from_top;
    case SensorReadout::Direction::right: return readout.duration_s * from_left;
    case SensorReadout::Direction::left: return -readout.duration_s * from_left;
  }
  return 0;
}

Eigen::Vector2d pixel_as_read(const Eigen::Vector2d& at_one_moment, const CameraModel& camera,
                              const SensorReadout& readout, const ShutterMotion& motion) {
  const Eigen::Matrix3d enu_from_camera_axes = enu_from_camera(motion.attitude);
  const Eigen::Vector3d rate_rad_s = camera_frame_rate(motion.rate_rad_s);
  const Eigen::Vector3d velocity_mps =
      enu_from_camera_axes.transpose() * Eigen::Vector3d(motion.velocity_mps.x(), motion.velocity_mps.y(), 0);
  const Eigen::Vector3d ray = camera.ray_from_pixel(at_one_moment);
  const double fall = -(enu_from_camera_axes.row(2) * ray).value();
  const Eigen::Vector3d passing = velocity_mps * (std::max(kShutterMinFall, fall) / motion.agl_m);  // v / λ
  Eigen::Vector2d seen = at_one_moment;
  for (int i = 0; i < kShutterIterations; ++i) {
    const double seconds = seconds_after_middle(camera, readout, seen);
    seen = camera.pixel_from_point(turned_back(rate_rad_s, seconds) * (ray - passing * seconds));
  }
  return seen;
}

Eigen::Vector2d pixel_at_one_moment(const Eigen::Vector2d& as_read, const CameraModel& camera,
                                    const SensorReadout& readout, const ShutterMotion& motion) {
  Eigen::Vector2d pixel = as_read;
  for (int i = 0; i < kShutterIterations; ++i) pixel += as_read - pixel_as_read(pixel, camera, readout, motion);
  return pixel;
}

cv::Mat without_rolling_shutter(const cv::Mat& image, const CameraModel& camera, const SensorReadout& readout,
                                const ShutterMotion& motion) {
  cv::Mat nodes(nodes_along(camera.height, kShutterNodes_px), nodes_along(camera.width, kShutterNodes_px), CV_32FC2);
  for (int r = 0; r < nodes.rows; ++r) {
    for (int c = 0; c < nodes.cols; ++c) {
      const Eigen::Vector2d seen =
          pixel_as_read(Eigen::Vector2d(c * kShutterNodes_px, r * kShutterNodes_px), camera, readout, motion);
      nodes.at<cv::Vec2f>(r, c) = {static_cast<float>(seen.x()), static_cast<float>(seen.y())};
    }
  }
  cv::Mat map(camera.height, camera.width, CV_32FC2), result;
  fill_between_nodes(nodes, kShutterNodes_px, map);
  cv::remap(image, result, map, cv::noArray(), cv::INTER_LINEAR, cv::BORDER_REPLICATE);
  return result;
}

}  // namespace nadir
