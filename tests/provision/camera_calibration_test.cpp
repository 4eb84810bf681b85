#include "provision/camera_calibration.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <opencv2/core.hpp>

#include "base/error.hpp"
#include "base/files.hpp"
#include "base/yaml.hpp"
#include "imagery/codecs.hpp"
#include "provision/board_scene.hpp"
#include "support/temporary_folder.hpp"
#include "vision/camera.hpp"

namespace nadir {
namespace {

using testing::HasSubstr;

const Board kBoard{.columns = 9, .rows = 6, .square_m = 0.025};

BoardImages find(const std::filesystem::path& folder) {
  NoProgress progress;
  return find_boards(folder, kBoard, progress);
}

test::BoardPose in_the_middle() { return {.tilt_x_rad = 0.3, .middle_px = {320, 240}, .depth_m = 0.5}; }

TEST(Board, IsParsedFromText) {
  const Board board = parse_board("9x6", 0.025);
  EXPECT_EQ(board.columns, 9);
  EXPECT_EQ(board.rows, 6);
  for (const char* text : {"", "9", "x", "9x", "x6", "9x6x", "9 x 6", "-9x6", "2x3", "51x6", "99999999999x6", "9X6"}) {
    EXPECT_THROW(parse_board(text, 0.025), UsageError) << text;
  }
}

TEST(Board, MustNotBeSymmetric) {
  EXPECT_THROW(parse_board("9x7", 0.025), UsageError);
  EXPECT_THROW(parse_board("8x6", 0.025), UsageError);
}

TEST(BoardImages, SkipUnusableImages) {
  const test::TemporaryFolder folder;
  const test::BoardScene scene(test::test_camera());
  const auto write = [&](const char* name, const cv::Mat& picture) {
    write_file_atomic(folder / name, encode_image(picture, ImageFormat::png));
  };
  test::BoardPose beyond = in_the_middle();
  beyond.middle_px.x() = 600;
  write("beyond.png", scene.picture(beyond, 0.6, 1));
  write("blurred.png", scene.picture(in_the_middle(), 4, 1));
  write("empty.png", cv::Mat(480, 640, CV_8UC1, cv::Scalar(90)));
  write("good.png", scene.picture(in_the_middle(), 0.6, 1));
  folder.write("cut.png", read_text_file(folder / "good.png").substr(0, 20000));
  folder.write("text.jpg", "this is no picture");
  folder.write("notes.txt", "not looked at");

  const BoardImages found = find(folder.path());
  ASSERT_EQ(found.views.size(), 1U);
  EXPECT_EQ(found.views[0].image, "good.png");
  EXPECT_EQ(found.views[0].corners.size(), 54U);
  std::vector<std::string> reasons;
  for (const RejectedImage& one : found.rejected) reasons.push_back(one.image + ": " + one.reason);
  EXPECT_THAT(reasons, testing::ElementsAre(HasSubstr("beyond.png: no whole board"), HasSubstr("blurred.png: blurred"),
                                            HasSubstr("cut.png: damaged"), HasSubstr("empty.png: no whole board"),
                                            HasSubstr("text.jpg: damaged")));
}

TEST(BoardImages, AnotherBoardIsNotFound) {
  const test::BoardScene scene(test::test_camera());
  const cv::Mat picture = scene.picture(in_the_middle(), 0.6, 1);
  EXPECT_TRUE(find_board(picture, kBoard, "p"));
  EXPECT_FALSE(find_board(picture, {.columns = 10, .rows = 7, .square_m = 0.025}, "p"));
}

TEST(BoardImages, MustHaveOneSize) {
  const test::TemporaryFolder folder;
  write_file_atomic(folder / "a.png", encode_image(cv::Mat(480, 640, CV_8UC1, cv::Scalar(90)), ImageFormat::png));
  write_file_atomic(folder / "b.png", encode_image(cv::Mat(240, 320, CV_8UC1, cv::Scalar(90)), ImageFormat::png));
  EXPECT_THROW(find(folder.path()), UsageError);
}

TEST(BoardImages, RequireAFolderWithImages) {
  const test::TemporaryFolder folder;
  EXPECT_THROW(find(folder.path()), UsageError);
  EXPECT_THROW(find(folder / "missing"), UsageError);
  EXPECT_THROW(find(folder.write("file", "x")), UsageError);
}

using test::BoardPose;

// What a perfect finder would see, but for a twentieth of a pixel.
BoardImages seen(const std::vector<BoardPose>& poses) {
  BoardImages pictures{.size = {640, 480}};
  cv::RNG random(1);
  for (const BoardPose& pose : poses) {
    BoardView view{.image = "image", .corners = test::true_corners(test::test_camera(), pose)};
    for (cv::Point2f& corner : view.corners) {
      corner += cv::Point2f(static_cast<float>(random.gaussian(0.05)), static_cast<float>(random.gaussian(0.05)));
    }
    pictures.views.push_back(view);
  }
  return pictures;
}

BoardImages good_views() { return seen(test::good_poses(test::test_camera())); }

TEST(Calibration, RecoversTheCamera) {
  const test::TemporaryFolder folder;
  test::write_pictures(folder.path(), test::test_camera(), test::good_poses(test::test_camera()), 0.6);
  NoProgress progress;
  const BoardImages pictures = find_boards(folder.path(), kBoard, progress);
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

TEST(Calibration, WritesAFileThatTheLocalizerReads) {
  const Calibration found = calibrate(good_views(), kBoard);
  const CameraModel read = read_camera(YamlNode::parse(camera_yaml(found.camera), "camera.yaml")).camera;
  EXPECT_EQ(read.width, 640);
  EXPECT_EQ(read.height, 480);
  EXPECT_NEAR(read.fx, found.camera.fx, 1e-4);
  EXPECT_NEAR(read.distortion[1], found.camera.distortion[1], 1e-8);
}

TEST(Calibration, RejectsTooFewImages) {
  BoardImages few = good_views();
  few.views.resize(5);
  EXPECT_TRUE(check_views(few, {}).contains("provision.few_pictures"));
  few.views.resize(2);
  EXPECT_THROW(calibrate(few, kBoard), Error);
}

TEST(Calibration, RejectsABoardThatStaysInTheMiddle) {
  std::vector<BoardPose> poses = test::good_poses(test::test_camera());
  for (BoardPose& pose : poses) {
    pose.middle_px = {320, 240};
    pose.depth_m = 0.9;
  }
  EXPECT_TRUE(check_views(seen(poses), {}).contains("provision.coverage"));
}

TEST(Calibration, RejectsABoardThatIsNeverTilted) {
  std::vector<BoardPose> poses = test::good_poses(test::test_camera());
  for (BoardPose& pose : poses) pose.tilt_x_rad = pose.tilt_y_rad = 0;
  const Calibration found = calibrate(seen(poses), kBoard);
  EXPECT_TRUE(check_calibration(found, {}).contains("provision.tilt")) << found.tilt_rad;
}

TEST(Calibration, RejectsABoardThatIsNotFlat) {
  BoardImages bent = good_views();
  for (BoardView& view : bent.views) {
    for (std::size_t i = 0; i < view.corners.size(); ++i) {
      view.corners[i].y += 3.0F * std::sin(static_cast<float>(i % 9));
    }
  }
  EXPECT_TRUE(check_calibration(calibrate(bent, kBoard), {}).contains("provision.residual"));
}

TEST(Calibration, RejectsALensThatCannotBeInverted) {
  Calibration found = calibrate(good_views(), kBoard);
  found.camera.distortion = {-3, 0, 0, 0, 0};
  EXPECT_TRUE(check_calibration(found, {}).contains("provision.lens"));
}

}  // namespace

}  // namespace nadir
