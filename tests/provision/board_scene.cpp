#include "provision/board_scene.hpp"

#include <fmt/format.h>

#include <Eigen/Geometry>
#include <cmath>
#include <opencv2/imgproc.hpp>
#include <vector>

#include "base/files.hpp"
#include "imagery/codecs.hpp"

namespace nadir::test {
namespace {

constexpr int kAcross = 10, kDown = 7;  // squares
constexpr double kSquare_m = 0.025;
constexpr int kSplit = 3;

// Light squares, dark squares, a light rim, and a grey wall behind.
double brightness(double x_m, double y_m) {
  const double x = x_m / kSquare_m + kAcross / 2.0;
  const double y = y_m / kSquare_m + kDown / 2.0;
  if (x < -1 || y < -1 || x > kAcross + 1 || y > kDown + 1) return 110;
  if (x < 0 || y < 0 || x >= kAcross || y >= kDown) return 220;
  return (static_cast<int>(x) + static_cast<int>(y)) % 2 == 0 ? 30 : 220;
}

Eigen::Matrix3d turn_of(const BoardPose& pose) {
  return (Eigen::AngleAxisd(pose.tilt_x_rad, Eigen::Vector3d::UnitX()) *
          Eigen::AngleAxisd(pose.tilt_y_rad, Eigen::Vector3d::UnitY()) *
          Eigen::AngleAxisd(pose.turn_rad, Eigen::Vector3d::UnitZ()))
      .toRotationMatrix();
}

}  // namespace

BoardScene::BoardScene(const CameraModel& camera) : camera_(camera) {
  for (int row = 0; row < camera.height * kSplit; ++row) {
    for (int column = 0; column < camera.width * kSplit; ++column) {
      // The middle of a pixel is a whole number.
      rays_.push_back(camera.ray_from_pixel({(column + 0.5) / kSplit - 0.5, (row + 0.5) / kSplit - 0.5}));
    }
  }
}

cv::Mat BoardScene::picture(const BoardPose& pose, double blur_px, unsigned seed) const {
  const Eigen::Matrix3d turn = turn_of(pose);
  const Eigen::Vector3d middle = camera_.ray_from_pixel(pose.middle_px) * pose.depth_m;
  const Eigen::Vector3d normal = turn.col(2);
  cv::Mat fine(camera_.height * kSplit, camera_.width * kSplit, CV_32FC1);
  std::size_t at = 0;
  for (int row = 0; row < fine.rows; ++row) {
    for (int column = 0; column < fine.cols; ++column) {
      const Eigen::Vector3d& ray = rays_[at++];
      const Eigen::Vector3d on_board = turn.transpose() * (ray * (normal.dot(middle) / normal.dot(ray)) - middle);
      fine.at<float>(row, column) = static_cast<float>(brightness(on_board.x(), on_board.y()));
    }
  }
  cv::Mat seen, noise(camera_.height, camera_.width, CV_32FC1), result;
  cv::GaussianBlur(fine, fine, {}, blur_px * kSplit);
  cv::resize(fine, seen, noise.size(), 0, 0, cv::INTER_AREA);
  cv::RNG(seed).fill(noise, cv::RNG::NORMAL, 0, 2);
  cv::Mat(seen + noise).convertTo(result, CV_8U);
  return result;
}

CameraModel test_camera() {
  return {.width = 640,
          .height = 480,
          .fx = 521.3,
          .fy = 519.8,
          .cx = 326.4,
          .cy = 233.7,
          .distortion = {-0.18, 0.07, 0.0008, -0.0005, 0}};
}

std::vector<BoardPose> good_poses(const CameraModel& camera) {
  std::vector<BoardPose> poses;
  for (int i = 0; i < 12; ++i) {
    const double phase = i * 2.399963;  // the golden angle: no two alike
    const double away = i == 0 ? 0 : 1;
    poses.push_back({.tilt_x_rad = 0.55 * std::cos(phase * 2),
                     .tilt_y_rad = 0.55 * std::sin(phase * 2),
                     .turn_rad = 0.25 * std::sin(phase * 3),
                     .middle_px = {camera.cx + away * 0.24 * camera.width * std::cos(phase),
                                   camera.cy + away * 0.24 * camera.height * std::sin(phase)},
                     .depth_m = 0.48});
  }
  return poses;
}

std::vector<cv::Point2f> true_corners(const CameraModel& camera, const BoardPose& pose) {
  const Eigen::Matrix3d turn = turn_of(pose);
  const Eigen::Vector3d middle = camera.ray_from_pixel(pose.middle_px) * pose.depth_m;
  std::vector<cv::Point2f> corners;
  for (int row = 1; row < kDown; ++row) {
    for (int column = 1; column < kAcross; ++column) {
      const Eigen::Vector3d on_board((column - kAcross / 2.0) * kSquare_m, (row - kDown / 2.0) * kSquare_m, 0);
      const Eigen::Vector2d pixel = camera.pixel_from_point(middle + turn * on_board);
      corners.emplace_back(static_cast<float>(pixel.x()), static_cast<float>(pixel.y()));
    }
  }
  return corners;
}

void write_pictures(const std::filesystem::path& folder, const CameraModel& camera, const std::vector<BoardPose>& poses,
                    double blur_px) {
  std::filesystem::create_directories(folder);
  const BoardScene scene(camera);
  for (std::size_t i = 0; i < poses.size(); ++i) {
    const cv::Mat picture = scene.picture(poses[i], blur_px, static_cast<unsigned>(i + 1));
    write_file_atomic(folder / fmt::format("{:02}.png", i), encode_image(picture, ImageFormat::png));
  }
}

}  // namespace nadir::test
