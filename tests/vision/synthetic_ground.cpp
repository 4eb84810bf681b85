#include "vision/synthetic_ground.hpp"

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <cmath>
#include <opencv2/imgproc.hpp>
#include <tuple>

#include "base/random.hpp"

namespace nadir::test {
namespace {

cv::Point point_of(double x, double y) { return {static_cast<int>(std::lround(x)), static_cast<int>(std::lround(y))}; }

std::vector<cv::Point> box(double x, double y, double width, double height, double turn) {
  std::vector<cv::Point> corners;
  for (const auto& [u, v] : {std::pair{-0.5, -0.5}, std::pair{0.5, -0.5}, std::pair{0.5, 0.5}, std::pair{-0.5, 0.5}}) {
    const double a = u * width, b = v * height;
    corners.push_back(
        point_of(x + a * std::cos(turn) - b * std::sin(turn), y + a * std::sin(turn) + b * std::cos(turn)));
  }
  return corners;
}

Eigen::Vector2d lens(const std::array<double, 5>& d, const Eigen::Vector2d& p) {
  const double x = p.x(), y = p.y(), r2 = p.squaredNorm();
  const double radial = 1 + d[0] * r2 + d[1] * r2 * r2 + d[4] * r2 * r2 * r2;
  return {x * radial + 2 * d[2] * x * y + d[3] * (r2 + 2 * x * x),
          y * radial + d[2] * (r2 + 2 * y * y) + 2 * d[3] * x * y};
}

Eigen::Vector2d undistorted(const std::array<double, 5>& d, const Eigen::Vector2d& seen) {
  Eigen::Vector2d p = seen;
  for (int i = 0; i < 30; ++i) {
    Eigen::Matrix2d jacobian;
    for (int k = 0; k < 2; ++k) {
      const Eigen::Vector2d step = 1e-6 * Eigen::Vector2d::Unit(k);
      jacobian.col(k) = (lens(d, p + step) - lens(d, p - step)) / 2e-6;
    }
    const Eigen::Vector2d change = jacobian.inverse() * (seen - lens(d, p));
    p += change;
    if (change.norm() < 1e-13) break;
  }
  return p;
}

// North-east-down: yaw about down, then pitch about right, then roll about forward.
Eigen::Matrix3d ned_from_camera(const Attitude& attitude) {
  using Eigen::AngleAxisd;
  using Eigen::Vector3d;
  const Eigen::Matrix3d ned_from_body =
      (AngleAxisd(attitude.heading_rad, Vector3d::UnitZ()) * AngleAxisd(attitude.pitch_rad, Vector3d::UnitY()) *
       AngleAxisd(attitude.roll_rad, Vector3d::UnitX()))
          .toRotationMatrix();
  Eigen::Matrix3d body_from_camera;
  body_from_camera.col(0) = Vector3d::UnitY();   // image right: the right wing
  body_from_camera.col(1) = -Vector3d::UnitX();  // image down: the tail
  body_from_camera.col(2) = Vector3d::UnitZ();   // optical axis: the belly
  return ned_from_body * body_from_camera;
}

// The ray of a pixel, where it meets the plane one focal length away.
Eigen::Vector2d ray_of(const CameraModel& camera, double x, double y) {
  const Eigen::Vector2d seen((x - camera.cx) / camera.fx, (y - camera.cy) / camera.fy);
  return camera.distorted() ? undistorted(camera.distortion, seen) : seen;
}

PlanePoint hit(const CameraPose& pose, const Eigen::Matrix3d& rotation, const Eigen::Vector2d& ray) {
  const Eigen::Vector3d ned = rotation * Eigen::Vector3d(ray.x(), ray.y(), 1);
  const double along = pose.agl_m / ned.z();
  return {pose.position.east_m + along * ned.y(), pose.position.north_m + along * ned.x()};
}

// Row by row, those of each pixel together.
std::vector<Eigen::Vector2d> rays_of(const CameraModel& camera, int samples) {
  std::vector<Eigen::Vector2d> rays;
  for (int r = 0; r < camera.height; ++r) {
    for (int c = 0; c < camera.width; ++c) {
      for (int j = 0; j < samples; ++j) {
        for (int i = 0; i < samples; ++i) {
          rays.push_back(ray_of(camera, c + (i + 0.5) / samples - 0.5, r + (j + 0.5) / samples - 0.5));
        }
      }
    }
  }
  return rays;
}

// Most of what a picture costs is to find its rays, and a test takes many with one camera.
const std::vector<Eigen::Vector2d>& known_rays_of(const CameraModel& camera, int samples) {
  const auto lens_of = [](const CameraModel& of) {
    return std::tuple(of.width, of.height, of.fx, of.fy, of.cx, of.cy, of.distortion);
  };
  thread_local CameraModel known_camera;
  thread_local int known_samples = 0;
  thread_local std::vector<Eigen::Vector2d> rays;
  if (known_samples != samples || lens_of(known_camera) != lens_of(camera)) {
    rays = rays_of(camera, samples);
    known_camera = camera;
    known_samples = samples;
  }
  return rays;
}

}  // namespace

double waves(PlanePoint p) {
  const auto wave = [&](double length_m, double direction, double phase) {
    const double along = p.east_m * std::cos(direction) + p.north_m * std::sin(direction);
    return std::sin(2 * 3.14159265358979 * along / length_m + phase);
  };
  return 128 + 30 * wave(60, 0.3, 0) + 25 * wave(35, 1.4, 1) + 20 * wave(22, 2.6, 2) + 15 * wave(14, 0.9, 3) +
         10 * wave(10, 2.0, 4);
}

Landscape::Landscape(std::uint64_t seed, double half_side_m, double gsd_m) : half_side_m_(half_side_m), gsd_m_(gsd_m) {
  Random random(seed);
  const int side = static_cast<int>(std::lround(2 * half_side_m / gsd_m));
  const double per_m = 1 / gsd_m;
  image_ = cv::Mat(side, side, CV_32FC1, cv::Scalar(120));
  const double area_m2 = 4 * half_side_m * half_side_m;
  const auto place = [&] { return random.uniform(0, side); };
  for (int i = 0; i < static_cast<int>(area_m2 / 1200); ++i) {  // parcels of some 50 m
    const auto corners =
        box(place(), place(), random.uniform(20, 90) * per_m, random.uniform(15, 60) * per_m, random.uniform(0, 3.14));
    cv::fillConvexPoly(image_, corners, cv::Scalar(random.uniform(60, 190)));
  }
  for (int i = 0; i < static_cast<int>(half_side_m / 25); ++i) {  // roads
    cv::line(image_, point_of(place(), 0), point_of(place(), side), cv::Scalar(random.uniform(190, 220)),
             point_of(5 * per_m, 0).x);
    cv::line(image_, point_of(0, place()), point_of(side, place()), cv::Scalar(random.uniform(40, 60)),
             point_of(4 * per_m, 0).x);
  }
  for (int i = 0; i < static_cast<int>(area_m2 / 500); ++i) {  // roofs and bushes
    cv::fillConvexPoly(
        image_,
        box(place(), place(), random.uniform(4, 14) * per_m, random.uniform(4, 9) * per_m, random.uniform(0, 3.14)),
        cv::Scalar(random.uniform(20, 240)));
  }
  cv::Mat grain(image_.size(), CV_32FC1);
  for (int r = 0; r < side; ++r) {
    for (int c = 0; c < side; ++c) grain.at<float>(r, c) = static_cast<float>(random.uniform(-40, 40));
  }
  cv::GaussianBlur(grain, grain, cv::Size(), 1.5, 1.5);
  image_ += grain;
  cv::GaussianBlur(image_, image_, cv::Size(), 0.8, 0.8);
}

double Landscape::grey(PlanePoint place) const {
  const double x = (place.east_m + half_side_m_) / gsd_m_ - 0.5, y = (half_side_m_ - place.north_m) / gsd_m_ - 0.5;
  const int c = static_cast<int>(std::floor(x)), r = static_cast<int>(std::floor(y));
  if (c < 0 || r < 0 || c + 1 >= image_.cols || r + 1 >= image_.rows) return 128;
  const double u = x - c, v = y - r;
  const auto at = [&](int row, int column) { return static_cast<double>(image_.at<float>(row, column)); };
  return (1 - v) * ((1 - u) * at(r, c) + u * at(r, c + 1)) + v * ((1 - u) * at(r + 1, c) + u * at(r + 1, c + 1));
}

MapWindow Landscape::map(double gsd_m, bool reversed) const {
  MapWindow window;
  const int side = static_cast<int>(std::floor(2 * half_side_m_ / gsd_m));
  window.west_m = -half_side_m_;
  window.north_m = half_side_m_;
  window.gsd_m = gsd_m;
  window.image.create(side, side, CV_8UC1);
  window.mask = cv::Mat(side, side, CV_8UC1, cv::Scalar(255));
  for (int r = 0; r < side; ++r) {
    for (int c = 0; c < side; ++c) {
      const double value = grey(window.plane_from_pixel(c + 0.5, r + 0.5));
      window.image.at<std::uint8_t>(r, c) = cv::saturate_cast<std::uint8_t>(reversed ? 220 - 0.7 * value : value);
    }
  }
  return window;
}

PlanePoint seen_by_pixel(const CameraModel& camera, const CameraPose& pose, double x, double y) {
  return hit(pose, ned_from_camera(pose.attitude), ray_of(camera, x, y));
}

cv::Mat photograph_moving(const Ground& ground, const CameraModel& camera,
                          const std::function<CameraPose(int x, int y)>& pose_at_pixel) {
  cv::Mat image(camera.height, camera.width, CV_8UC1);
  for (int y = 0; y < image.rows; ++y) {
    for (int x = 0; x < image.cols; ++x) {
      image.at<std::uint8_t>(y, x) =
          cv::saturate_cast<std::uint8_t>(ground(seen_by_pixel(camera, pose_at_pixel(x, y), x, y)));
    }
  }
  return image;
}

double row_seconds(const CameraModel& camera, double readout_s, int y) {
  return ((y + 0.5) / camera.height - 0.5) * readout_s;
}

cv::Mat photograph(const Ground& ground, const CameraModel& camera, const CameraPose& pose, int samples) {
  const Eigen::Matrix3d rotation = ned_from_camera(pose.attitude);
  cv::Mat picture(camera.height, camera.width, CV_8UC1);
  auto ray = known_rays_of(camera, samples).begin();
  for (int r = 0; r < camera.height; ++r) {
    for (int c = 0; c < camera.width; ++c) {
      double sum = 0;
      for (int i = 0; i < samples * samples; ++i) sum += ground(hit(pose, rotation, *ray++));
      picture.at<std::uint8_t>(r, c) = cv::saturate_cast<std::uint8_t>(sum / (samples * samples));
    }
  }
  return picture;
}

CameraModel small_camera() {
  CameraModel camera;
  camera.width = 320;
  camera.height = 240;
  camera.fx = camera.fy = 190;
  camera.cx = 158.3;
  camera.cy = 121.6;
  return camera;
}

CameraModel bent_camera() {
  CameraModel camera = small_camera();
  camera.distortion = {-0.18, 0.04, 0.001, -0.0015, 0};
  return camera;
}

cv::Mat coordinates(const CameraModel& camera) {
  cv::Mat picture(camera.height, camera.width, CV_32FC2);
  for (int r = 0; r < camera.height; ++r) {
    for (int c = 0; c < camera.width; ++c) {
      picture.at<cv::Vec2f>(r, c) = {static_cast<float>(c), static_cast<float>(r)};
    }
  }
  return picture;
}

}  // namespace nadir::test
