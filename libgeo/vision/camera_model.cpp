#include "vision/camera_model.hpp"

#include <Eigen/LU>
#include <cmath>

namespace nadir {
namespace {

// Brown-Conrady: where the undistorted image point (x, y) at z = 1 appears.
Eigen::Vector2d distort(const std::array<double, 5>& d, const Eigen::Vector2d& point) {
  const double x = point.x(), y = point.y();
  const double r2 = x * x + y * y;
  const double radial = 1 + r2 * (d[0] + r2 * (d[1] + r2 * d[4]));
  return {x * radial + 2 * d[2] * x * y + d[3] * (r2 + 2 * x * x),
          y * radial + d[2] * (r2 + 2 * y * y) + 2 * d[3] * x * y};
}

// How the distorted point moves with the undistorted one.
Eigen::Matrix2d distortion_jacobian(const std::array<double, 5>& d, const Eigen::Vector2d& point) {
  const double x = point.x(), y = point.y();
  const double r2 = x * x + y * y;
  const double radial = 1 + r2 * (d[0] + r2 * (d[1] + r2 * d[4]));
  const double growth = 2 * (d[0] + r2 * (2 * d[1] + r2 * 3 * d[4]));  // of `radial` with r2, doubled
  const double mixed = x * y * growth + 2 * d[2] * x + 2 * d[3] * y;
  Eigen::Matrix2d jacobian;
  jacobian << radial + x * x * growth + 2 * d[2] * y + 6 * d[3] * x, mixed,  //
      mixed, radial + y * y * growth + 6 * d[2] * y + 2 * d[3] * x;
  return jacobian;
}

// A barrel lens' polynomial turns back far outside of the picture. Up to which share of the way to `point` does the
// image still move outwards?
double share_before_fold(const std::array<double, 5>& d, const Eigen::Vector2d& point) {
  const double r2 = point.squaredNorm();
  const auto outwards = [&](double share) {
    const double s = share * share * r2;
    return 1 + s * (3 * d[0] + s * (5 * d[1] + s * 7 * d[4])) > 0;
  };
  constexpr int kProbes = 8;
  for (int i = 1; i <= kProbes; ++i) {
    double before = (i - 1.0) / kProbes, after = static_cast<double>(i) / kProbes;
    if (outwards(after)) continue;
    for (int halving = 0; halving < 20; ++halving) {
      const double middle = 0.5 * (before + after);
      (outwards(middle) ? before : after) = middle;
    }
    return before;
  }
  return 1;
}

}  // namespace

Eigen::Vector2d CameraModel::pixel_from_point(const Eigen::Vector3d& point) const {
  Eigen::Vector2d image = point.head<2>() / point.z();
  if (distorted()) {
    const Eigen::Vector2d one_to_one = share_before_fold(distortion, image) * image;
    image += distort(distortion, one_to_one) - one_to_one;  // beyond the fold, straight on
  }
  return {fx * image.x() + cx, fy * image.y() + cy};
}

Eigen::Vector3d CameraModel::ray_from_pixel(const Eigen::Vector2d& pixel) const {
  const Eigen::Vector2d seen((pixel.x() - cx) / fx, (pixel.y() - cy) / fy);
  Eigen::Vector2d image = seen;
  if (distorted()) {
    for (int i = 0; i < 50; ++i) {  // Newton: a handful of rounds, up to the fold
      const Eigen::Vector2d error = distort(distortion, image) - seen;
      image -= distortion_jacobian(distortion, image).inverse() * error;
      if (error.squaredNorm() < 1e-24) break;
    }
  }
  return {image.x(), image.y(), 1.0};
}

CameraModel CameraModel::scaled(double factor) const {
  CameraModel result = *this;
  result.width = static_cast<int>(std::lround(width * factor));
  result.height = static_cast<int>(std::lround(height * factor));
  const double sx = static_cast<double>(result.width) / width;
  const double sy = static_cast<double>(result.height) / height;
  result.fx = fx * sx;
  result.fy = fy * sy;
  result.cx = (cx + 0.5) * sx - 0.5;  // pixel centres are at whole numbers
  result.cy = (cy + 0.5) * sy - 0.5;
  return result;
}

Eigen::Matrix3d enu_from_camera(const Attitude& attitude) {
  const double ch = std::cos(attitude.heading_rad), sh = std::sin(attitude.heading_rad);
  const double cp = std::cos(attitude.pitch_rad), sp = std::sin(attitude.pitch_rad);
  const double cr = std::cos(attitude.roll_rad), sr = std::sin(attitude.roll_rad);
  // North-east-down from body (forward, right, down), yaw-pitch-roll.
  Eigen::Matrix3d ned_from_body;
  ned_from_body << ch * cp, ch * sp * sr - sh * cr, ch * sp * cr + sh * sr,  //
      sh * cp, sh * sp * sr + ch * cr, sh * sp * cr - ch * sr,               //
      -sp, cp * sr, cp * cr;
  Eigen::Matrix3d enu_from_ned, body_from_camera;
  enu_from_ned << 0, 1, 0, 1, 0, 0, 0, 0, -1;
  body_from_camera << 0, -1, 0, 1, 0, 0, 0, 0, 1;  // image-up is forward, image-right is right
  return enu_from_ned * ned_from_body * body_from_camera;
}

}  // namespace nadir
