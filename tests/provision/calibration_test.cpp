#include "provision/calibration.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <opencv2/core.hpp>

#include "base/error.hpp"
#include "base/yaml.hpp"
#include "provision/board_scene.hpp"
#include "support/temporary_folder.hpp"
#include "vision/camera.hpp"

namespace nadir {
namespace {

using test::BoardPose;

const Board kBoard{.columns = 9, .rows = 6, .square_m = 0.025};

// What a perfect finder would see, but for a twentieth of a pixel.
BoardPictures seen(const std::vector<BoardPose>& poses) {
  BoardPictures pictures{.size = {640, 480}};
  cv::RNG random(1);
  for (const BoardPose& pose : poses) {
    BoardView view{.picture = "picture", .corners = test::true_corners(test::test_camera(), pose)};
    for (cv::Point2f& corner : view.corners) {
      corner += cv::Point2f(static_cast<float>(random.gaussian(0.05)), static_cast<float>(random.gaussian(0.05)));
    }
    pictures.views.push_back(view);
  }
  return pictures;
}

BoardPictures good_views() { return seen(test::good_poses(test::test_camera())); }

TEST(Calibration, FindsTheCameraThatTookThePictures) {
  const test::TemporaryFolder folder;
  test::write_pictures(folder.path(), test::test_camera(), test::good_poses(test::test_camera()), 0.6);
  NoProgress progress;
  const BoardPictures pictures = find_boards(folder.path(), kBoard, progress);
  ASSERT_EQ(pictures.views.size(), 12U);
  const CalibrationLimits limits;
  EXPECT_TRUE(check_views(pictures, limits).empty());
  const Calibration found = calibrate(pictures, kBoard);
  EXPECT_TRUE(check_calibration(found, limits).empty());
  const CameraModel truth = test::test_camera();
  EXPECT_NEAR(found.camera.fx, truth.fx, 0.003 * truth.fx);
  EXPECT_NEAR(found.camera.fy, truth.fy, 0.003 * truth.fy);
  EXPECT_NEAR(found.camera.cx, truth.cx, 2);
  EXPECT_NEAR(found.camera.cy, truth.cy, 2);
  EXPECT_LT(found.residual_px, 0.2);
  // What counts in flight: where each pixel looks, over the whole picture.
  for (int x = 0; x < truth.width; x += 71) {
    for (int y = 0; y < truth.height; y += 53) {
      const Eigen::Vector2d pixel(x, y);
      EXPECT_LT((found.camera.pixel_from_point(truth.ray_from_pixel(pixel)) - pixel).norm(), 0.7) << x << ' ' << y;
    }
  }
}

TEST(Calibration, WritesWhatTheLocalizerReads) {
  const Calibration found = calibrate(good_views(), kBoard);
  const CameraModel read = read_camera(YamlNode::parse(camera_yaml(found.camera), "camera.yaml")).camera;
  EXPECT_EQ(read.width, 640);
  EXPECT_EQ(read.height, 480);
  EXPECT_NEAR(read.fx, found.camera.fx, 1e-4);
  EXPECT_NEAR(read.distortion[1], found.camera.distortion[1], 1e-8);
}

TEST(Calibration, RefusesTooFewPictures) {
  BoardPictures few = good_views();
  few.views.resize(5);
  EXPECT_TRUE(check_views(few, {}).contains("provision.few_pictures"));
  few.views.resize(2);
  EXPECT_THROW(calibrate(few, kBoard), Error);
}

TEST(Calibration, RefusesABoardThatStaysInTheMiddle) {
  std::vector<BoardPose> poses = test::good_poses(test::test_camera());
  for (BoardPose& pose : poses) {
    pose.middle_px = {320, 240};
    pose.depth_m = 0.9;
  }
  EXPECT_TRUE(check_views(seen(poses), {}).contains("provision.coverage"));
}

TEST(Calibration, RefusesABoardThatIsNeverTilted) {
  std::vector<BoardPose> poses = test::good_poses(test::test_camera());
  for (BoardPose& pose : poses) pose.tilt_x_rad = pose.tilt_y_rad = 0;
  const Calibration found = calibrate(seen(poses), kBoard);
  EXPECT_TRUE(check_calibration(found, {}).contains("provision.tilt")) << found.tilt_rad;
}

TEST(Calibration, RefusesABoardThatWasNotFlat) {
  BoardPictures bent = good_views();
  for (BoardView& view : bent.views) {
    for (std::size_t i = 0; i < view.corners.size(); ++i) {
      view.corners[i].y += 3.0F * std::sin(static_cast<float>(i % 9));
    }
  }
  EXPECT_TRUE(check_calibration(calibrate(bent, kBoard), {}).contains("provision.residual"));
}

TEST(Calibration, RefusesALensThatCannotBeUndone) {
  Calibration found = calibrate(good_views(), kBoard);
  found.camera.distortion = {-3, 0, 0, 0, 0};
  EXPECT_TRUE(check_calibration(found, {}).contains("provision.lens"));
}

}  // namespace
}  // namespace nadir
