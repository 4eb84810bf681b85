#include "vision/camera.hpp"

#include <gtest/gtest.h>

#include <Eigen/LU>

#include <cmath>

#include "geodesy/angles.hpp"
#include "vision/synthetic_ground.hpp"

namespace nadir {
namespace {

using test::seen_by_pixel;
using test::small_camera;

CameraModel with_lens(std::array<double, 5> distortion) {
  CameraModel camera = small_camera();
  camera.width = 2000;
  camera.height = 1500;
  camera.fx = 1400;
  camera.fy = 1420;
  camera.cx = 1010;
  camera.cy = 735;
  camera.distortion = distortion;
  return camera;
}

double worst_round_trip_px(const CameraModel& camera) {
  double worst = 0;
  for (double x = 0; x < camera.width; x += 37) {
    for (double y = 0; y < camera.height; y += 41) {
      const Eigen::Vector3d ray = camera.ray_from_pixel({x, y});
      EXPECT_EQ(ray.z(), 1.0);
      worst = std::max(worst, (camera.pixel_from_point(7.5 * ray) - Eigen::Vector2d(x, y)).norm());
    }
  }
  return worst;
}

TEST(CameraModel, PixelsComeBackOverTheWholePicture) {
  EXPECT_LT(worst_round_trip_px(with_lens({})), 1e-9);
  EXPECT_LT(worst_round_trip_px(with_lens({-0.28, 0.09, 0.0008, -0.0011, -0.01})), 1e-6) << "an action camera";
  EXPECT_LT(worst_round_trip_px(with_lens({0.12, 0.05, -0.001, 0.002, 0.03})), 1e-6) << "pincushion";
  EXPECT_LT(worst_round_trip_px(with_lens({0.4, 0.1, 0, 0, 0})), 1e-6) << "strong pincushion";
  EXPECT_LT(worst_round_trip_px(with_lens({-0.33, 0.05, 0, 0, 0})), 1e-6) << "nearly folding at the corners";
}

// Far outside of the picture a barrel lens' polynomial turns back and would show the rim a second time.
TEST(CameraModel, OutsideStaysOutside) {
  for (const std::array<double, 5>& lens : {std::array<double, 5>{-0.3, 0, 0, 0, 0},
                                            {-0.28, 0.09, 0.0008, -0.0011, -0.01},
                                            {-0.2, -0.05, 0.001, 0, 0},
                                            {0.1, -0.2, 0, 0.001, 0.01}}) {
    CameraModel camera = with_lens(lens);
    camera.fx = camera.fy = 2000;
    for (const double direction : {0.0, 0.7, 2.5, 4.0}) {
      double last = 0;
      for (double r = 0.02; r < 20; r *= 1.1) {
        const Eigen::Vector2d pixel = camera.pixel_from_point({r * std::cos(direction), r * std::sin(direction), 1.0});
        const double out = (pixel - Eigen::Vector2d(camera.cx, camera.cy)).norm();
        EXPECT_GT(out, last) << r;
        last = out;
      }
      EXPECT_GT(last, 2000);
    }
  }
}

// Values computed by hand from OpenCV's formula: x = 0.2, y = -0.1, r² = 0.05.
TEST(CameraModel, DistortsAsOpencvDoes) {
  CameraModel camera;
  camera.width = camera.height = 1000;
  camera.fx = camera.fy = 1000;
  camera.cx = camera.cy = 500;
  camera.distortion = {0.2, -0.4, 0.01, -0.02, 0.8};
  const double radial = 1 + 0.2 * 0.05 - 0.4 * 0.0025 + 0.8 * 0.000125;
  const double x = 0.2 * radial + 2 * 0.01 * (0.2 * -0.1) - 0.02 * (0.05 + 2 * 0.04);
  const double y = -0.1 * radial + 0.01 * (0.05 + 2 * 0.01) + 2 * -0.02 * (0.2 * -0.1);
  const Eigen::Vector2d pixel = camera.pixel_from_point({0.4, -0.2, 2});
  EXPECT_NEAR(pixel.x(), 500 + 1000 * x, 1e-9);
  EXPECT_NEAR(pixel.y(), 500 + 1000 * y, 1e-9);
}

// A picture and its reduced copy show the same things in the same directions: pixel edges scale, not centres.
TEST(CameraModel, ScaledSeesTheSameWorld) {
  const CameraModel camera = with_lens({-0.28, 0.09, 0.0008, -0.0011, -0.01});
  for (const double factor : {0.5, 0.25, 0.371}) {
    const CameraModel half = camera.scaled(factor);
    EXPECT_EQ(half.width, std::lround(2000 * factor));
    EXPECT_EQ(half.height, std::lround(1500 * factor));
    for (const Eigen::Vector2d& pixel : {Eigen::Vector2d(0, 0), Eigen::Vector2d(1999, 3), Eigen::Vector2d(700, 1400)}) {
      const Eigen::Vector3d ray = camera.ray_from_pixel(pixel);
      const Eigen::Vector2d there = half.pixel_from_point(ray);
      EXPECT_NEAR((there.x() + 0.5) / half.width, (pixel.x() + 0.5) / camera.width, 1e-9);
      EXPECT_NEAR((there.y() + 0.5) / half.height, (pixel.y() + 0.5) / camera.height, 1e-9);
    }
  }
}

// By hand: what do image-right, image-down and the axis point to?
TEST(Attitude, LevelAndNorth) {
  const Eigen::Matrix3d m = enu_from_camera({});
  EXPECT_NEAR((m.col(0) - Eigen::Vector3d(1, 0, 0)).norm(), 0, 1e-12) << "image right is east";
  EXPECT_NEAR((m.col(1) - Eigen::Vector3d(0, -1, 0)).norm(), 0, 1e-12) << "image down is south";
  EXPECT_NEAR((m.col(2) - Eigen::Vector3d(0, 0, -1)).norm(), 0, 1e-12) << "the axis is down";
}

TEST(Attitude, HeadingIsClockwise) {
  const Eigen::Matrix3d m = enu_from_camera({radians(90), 0, 0});
  EXPECT_NEAR((-m.col(1) - Eigen::Vector3d(1, 0, 0)).norm(), 0, 1e-12) << "image up is east";
  EXPECT_NEAR((m.col(0) - Eigen::Vector3d(0, -1, 0)).norm(), 0, 1e-12) << "image right is south";
}

TEST(Attitude, NoseUpLooksAhead) {
  const Eigen::Vector3d axis = enu_from_camera({radians(90), radians(10), 0}).col(2);
  EXPECT_NEAR(axis.x(), std::sin(radians(10)), 1e-12) << "ahead is east";
  EXPECT_NEAR(axis.y(), 0, 1e-12);
}

TEST(Attitude, RightWingDownLooksLeft) {
  const Eigen::Vector3d axis = enu_from_camera({0, 0, radians(20)}).col(2);
  EXPECT_NEAR(axis.x(), -std::sin(radians(20)), 1e-12) << "left is west";
  EXPECT_NEAR(axis.y(), 0, 1e-12);
}

// Yaw, pitch, roll in the order of aviation: the pitch turns about the levelled right wing, the roll about the nose.
TEST(Attitude, OrderOfAviation) {
  const Eigen::Matrix3d m = enu_from_camera({radians(30), radians(10), radians(25)});
  EXPECT_NEAR(-m(2, 1), std::sin(radians(10)), 1e-12) << "the nose rises by the pitch, whatever the roll";
  EXPECT_NEAR(std::atan2(-m(0, 1), -m(1, 1)), radians(30), 1e-12) << "the nose's course is the heading";
  EXPECT_NEAR(-m(2, 0), std::sin(radians(25)) * std::cos(radians(10)), 1e-12) << "the right wing falls";
  EXPECT_NEAR(m.determinant(), 1, 1e-12);
}

TEST(Attitude, AgreesWithTheRayCaster) {
  const CameraModel camera = with_lens({-0.2, 0.05, 0.001, 0.001, 0});
  const CameraPose pose{{12, -7}, 130, {radians(200), radians(-8), radians(15)}};
  for (const Eigen::Vector2d& pixel : {Eigen::Vector2d(0, 0), Eigen::Vector2d(1999, 0), Eigen::Vector2d(300, 1200)}) {
    const auto ground = ground_from_ray(pose, camera.ray_from_pixel(pixel));
    ASSERT_TRUE(ground);
    const PlanePoint expected = seen_by_pixel(camera, pose, pixel.x(), pixel.y());
    EXPECT_NEAR(ground->east_m, expected.east_m, 1e-6);
    EXPECT_NEAR(ground->north_m, expected.north_m, 1e-6);
  }
}

}  // namespace
}  // namespace nadir
