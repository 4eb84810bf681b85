#include "vision/rolling_shutter.hpp"

#include <gtest/gtest.h>

#include <opencv2/core.hpp>

#include "geodesy/angles.hpp"
#include "vision/synthetic_ground.hpp"

namespace nadir {
namespace {

using Direction = SensorReadout::Direction;

// A camera that moves and turns while it reads an image. The turn is given by its angles' rates, as the oracle has
// them.
struct Passing {
  CameraPose middle{.position = {12, -7}, .agl_m = 100, .attitude = {radians(30), radians(8), radians(-12)}};
  Eigen::Vector2d velocity_mps{15, 20};
  Attitude rate{radians(12), radians(-15), radians(40)};  // of heading, pitch and roll

  CameraPose at(double seconds) const {
    CameraPose pose = middle;
    pose.position = PlanePoint(middle.position.vector() + velocity_mps * seconds);
    pose.attitude.heading_rad += rate.heading_rad * seconds;
    pose.attitude.pitch_rad += rate.pitch_rad * seconds;
    pose.attitude.roll_rad += rate.roll_rad * seconds;
    return pose;
  }
  ShutterMotion motion() const {
    return {middle.attitude, middle.agl_m, velocity_mps, camera_rate(at(-1e-4).attitude, at(1e-4).attitude, 2e-4)};
  }
  // Line after line, each from where the camera is then.
  cv::Mat photograph(const CameraModel& camera, const SensorReadout& readout) const {
    return test::photograph_moving(test::waves, camera,
                                   [&](int x, int y) { return at(oracle_seconds(camera, readout, x, y)); });
  }
  static double oracle_seconds(const CameraModel& camera, const SensorReadout& readout, int x, int y) {
    const bool rows = readout.direction == Direction::down || readout.direction == Direction::up;
    const bool forwards = readout.direction == Direction::down || readout.direction == Direction::right;
    const int lines = rows ? camera.height : camera.width, line = rows ? y : x;
    const double line_s = readout.duration_s / lines;
    return ((forwards ? line : lines - 1 - line) - (lines - 1) / 2.0) * line_s;
  }
};

// Of the image without a margin, where other ground is seen.
double difference(const cv::Mat& a, const cv::Mat& b) {
  const cv::Rect inner(24, 24, a.cols - 48, a.rows - 48);
  return cv::norm(a(inner), b(inner), cv::NORM_L1) / static_cast<double>(inner.area());
}

TEST(RollingShutter, IsUndoneInEachDirectionAndWithABentLens) {
  const Passing passing;
  for (const CameraModel& camera : {test::small_camera(), test::bent_camera()}) {
    const cv::Mat wanted = test::photograph(test::waves, camera, passing.middle);
    for (const Direction direction : {Direction::down, Direction::up, Direction::right, Direction::left}) {
      const SensorReadout readout{0.03, direction};
      const cv::Mat rolled = passing.photograph(camera, readout);
      const cv::Mat undone = without_rolling_shutter(rolled, camera, readout, passing.motion());
      const double before = difference(rolled, wanted), after = difference(undone, wanted);
      EXPECT_GT(before, 2) << name_of(direction);
      EXPECT_LT(after, 0.35) << name_of(direction) << ": it was " << before;
    }
  }
}

TEST(RollingShutter, TheTurnIsUndoneWithoutAHeightAndAbovTheHorizon) {
  Passing passing;
  passing.velocity_mps.setZero();
  ShutterMotion motion = passing.motion();
  const CameraModel camera = test::small_camera();
  const SensorReadout readout{0.03};
  const cv::Mat rolled = passing.photograph(camera, readout);
  const cv::Mat undone = without_rolling_shutter(rolled, camera, readout, motion);
  EXPECT_LT(difference(undone, test::photograph(test::waves, camera, passing.middle)), 0.35);
  motion.agl_m = 1e6;
  EXPECT_EQ(cv::norm(undone, without_rolling_shutter(rolled, camera, readout, motion), cv::NORM_INF), 0);
  motion.attitude.pitch_rad = radians(80);
  motion.velocity_mps = {25, 0};
  EXPECT_EQ(without_rolling_shutter(rolled, camera, readout, motion).size(), rolled.size());
}

TEST(RollingShutter, PixelsGoThereAndBack) {
  const Passing passing;
  const SensorReadout readout{0.03};
  for (const CameraModel& camera : {test::small_camera(), test::bent_camera()}) {
    const Eigen::Vector2d pixel(200, 30), read = pixel_as_read(pixel, camera, readout, passing.motion());
    EXPECT_GT((read - pixel).norm(), 1);
    EXPECT_LT((pixel_at_one_moment(read, camera, readout, passing.motion()) - pixel).norm(), 0.02);
  }
}

TEST(RollingShutter, ACameraAtRestSeesTheSame) {
  const CameraModel camera = test::small_camera();
  const cv::Mat image = test::photograph(test::waves, camera, {});
  const cv::Mat same = without_rolling_shutter(image, camera, {0.03}, {});
  EXPECT_LE(cv::norm(image, same, cv::NORM_INF), 1);
}

TEST(RollingShutter, TimesCountFromTheMiddleLine) {
  const CameraModel camera = test::small_camera();  // 240 rows
  const SensorReadout readout{0.024};
  EXPECT_NEAR(seconds_after_middle(camera, readout, {0, 0}), -0.01195, 1e-9);
  EXPECT_NEAR(seconds_after_middle(camera, readout, {300, 239}), 0.01195, 1e-9);
  EXPECT_NEAR(seconds_after_middle(camera, readout, {7, 119.5}), 0, 1e-12);
  // The same lines, whatever the image was reduced to.
  EXPECT_NEAR(seconds_after_middle(camera.scaled(0.5), readout, {0, 59.5}), 0, 1e-12);
}

}  // namespace
}  // namespace nadir
