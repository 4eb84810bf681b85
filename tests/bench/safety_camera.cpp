#include "safety_camera.hpp"

#include <opencv2/imgproc.hpp>

#include "geodesy/angles.hpp"

namespace nadir::bench {

CameraFile camera_file() {
  CameraFile file;
  file.camera = {320, 240, 250.6, 250.4, 160.8, 118.9, {-0.085, 0.032, 0.0004, -0.0003, 0}};
  file.uncertainty = {radians(2.5), 0.03, radians(0.8)};
  return file;
}

Photographer::Photographer(const CameraModel& camera) : camera_(camera) {
  for (int row = 0; row < camera.height; ++row) {
    for (int column = 0; column < camera.width; ++column) rays_.push_back(camera.ray_from_pixel({column, row}));
  }
}

cv::Mat Photographer::photograph(const World& world, const CameraPose& pose) const {
  return photograph(world.day, kWorldGsd_m, world.terrain, pose);
}

cv::Mat Photographer::photograph(const cv::Mat& ground, double gsd_m, const GroundSurface& surface,
                                 const CameraPose& pose) const {
  const Eigen::Matrix3d rotation = enu_from_camera(pose.attitude);
  const double ground_m = surface.height_m(pose.position);
  cv::Mat_<cv::Vec2f> from(camera_.height, camera_.width);
  for (std::size_t i = 0; i < rays_.size(); ++i) {
    const Eigen::Vector3d ray = rotation * rays_[i];
    const double fall = std::max(0.1, -ray.z());
    PlanePoint place = pose.position;
    for (int round = 0; round < 3; ++round) {  // gentle hills: the height at the previous iterate is close enough
      const double along = (pose.agl_m + ground_m - surface.height_m(place)) / fall;
      place = {pose.position.east_m + along * ray.x(), pose.position.north_m + along * ray.y()};
    }
    const cv::Point2f pixel(pixel_of(place, ground.size(), gsd_m));
    from(static_cast<int>(i)) = {pixel.x, pixel.y};
  }
  cv::Mat picture;
  cv::remap(ground, picture, from, cv::noArray(), cv::INTER_LINEAR, cv::BORDER_REFLECT);
  return picture;
}

void add_clouds(cv::Mat& bgr, double share, Random& random) {
  cv::Mat cover(bgr.size(), CV_8UC1, cv::Scalar(0));
  while (cv::countNonZero(cover) < share * static_cast<double>(cover.total())) {
    const cv::Point middle(random.integer(0, bgr.cols), random.integer(0, bgr.rows));
    cv::circle(cover, middle, random.integer(15, 60), cv::Scalar(255), cv::FILLED);
  }
  cv::GaussianBlur(cover, cover, cv::Size(), 6);
  cv::Mat thickness, white(bgr.size(), CV_8UC3, cv::Scalar(238, 235, 232)), rest;
  cv::merge(std::vector<cv::Mat>(3, cover), thickness);
  cv::bitwise_not(thickness, rest);
  cv::multiply(bgr, rest, bgr, 1 / 255.0);
  cv::multiply(white, thickness, white, 1 / 255.0);
  cv::add(bgr, white, bgr);
}

void make_night(cv::Mat& bgr, Random& random) {
  const double light = random.uniform(0.02, 0.15), noise = random.uniform(2, 12);
  for (int row = 0; row < bgr.rows; ++row) {
    for (int column = 0; column < bgr.cols; ++column) {
      for (int i = 0; i < 3; ++i) {
        std::uint8_t& value = bgr.at<cv::Vec3b>(row, column)[i];
        value = cv::saturate_cast<std::uint8_t>(8 + light * value + random.normal(0, noise));
      }
    }
  }
}

}  // namespace nadir::bench
