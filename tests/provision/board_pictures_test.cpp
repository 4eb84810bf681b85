#include "provision/camera_calibration.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "base/error.hpp"
#include "base/files.hpp"
#include "imagery/codecs.hpp"
#include "provision/board_scene.hpp"
#include "support/temporary_folder.hpp"

namespace nadir {
namespace {

using testing::HasSubstr;

const Board kBoard{.columns = 9, .rows = 6, .square_m = 0.025};

BoardImages find(const std::filesystem::path& folder) {
  NoProgress progress;
  return find_boards(folder, kBoard, progress);
}

test::BoardPose in_the_middle() { return {.tilt_x_rad = 0.3, .middle_px = {320, 240}, .depth_m = 0.5}; }

TEST(Board, IsReadFromText) {
  const Board board = parse_board("9x6", 0.025);
  EXPECT_EQ(board.columns, 9);
  EXPECT_EQ(board.rows, 6);
  for (const char* text : {"", "9", "x", "9x", "x6", "9x6x", "9 x 6", "-9x6", "2x3", "51x6", "99999999999x6", "9X6"}) {
    EXPECT_THROW(parse_board(text, 0.025), UsageError) << text;
  }
}

TEST(Board, MustNotLookTheSameTurnedRound) {
  EXPECT_THROW(parse_board("9x7", 0.025), UsageError);
  EXPECT_THROW(parse_board("8x6", 0.025), UsageError);
}

TEST(BoardImages, SetsAsideWhatDoesNotHelp) {
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

TEST(BoardImages, AnotherBoardIsNotTheBoard) {
  const test::BoardScene scene(test::test_camera());
  const cv::Mat picture = scene.picture(in_the_middle(), 0.6, 1);
  EXPECT_TRUE(find_board(picture, kBoard, "p"));
  EXPECT_FALSE(find_board(picture, {.columns = 10, .rows = 7, .square_m = 0.025}, "p"));
}

TEST(BoardImages, AreOfOneSize) {
  const test::TemporaryFolder folder;
  write_file_atomic(folder / "a.png", encode_image(cv::Mat(480, 640, CV_8UC1, cv::Scalar(90)), ImageFormat::png));
  write_file_atomic(folder / "b.png", encode_image(cv::Mat(240, 320, CV_8UC1, cv::Scalar(90)), ImageFormat::png));
  EXPECT_THROW(find(folder.path()), UsageError);
}

TEST(BoardImages, NeedsAFolderWithPictures) {
  const test::TemporaryFolder folder;
  EXPECT_THROW(find(folder.path()), UsageError);
  EXPECT_THROW(find(folder / "missing"), UsageError);
  EXPECT_THROW(find(folder.write("file", "x")), UsageError);
}

}  // namespace
}  // namespace nadir
