// A video as the pictures of an imported flight, through the real plug-in.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <opencv2/core.hpp>
#include <opencv2/videoio.hpp>

#include "base/error.hpp"
#include "base/files.hpp"
#include "flight_import/video_frames.hpp"
#include "support/temporary_folder.hpp"

namespace nadir {
namespace {

class ImportVideo : public ::testing::Test {
 protected:
  // Two seconds at five frames a second, each brighter than the one before.
  std::filesystem::path video() {
    const auto file = folder_ / "flight.avi";
    cv::VideoWriter writer(file.string(), cv::CAP_OPENCV_MJPEG, cv::VideoWriter::fourcc('M', 'J', 'P', 'G'), 5,
                           {64, 48});
    EXPECT_TRUE(writer.isOpened());
    for (int i = 0; i < 10; ++i) writer.write(cv::Mat(48, 64, CV_8UC3, cv::Scalar::all(20 + 20 * i)));
    return file;
  }
  VideoFrames unpack(const std::filesystem::path& file, double interval_s) {
    std::filesystem::create_directory(folder_ / "frames");
    return unpack_video({file, interval_s, {PLUGIN_FOLDER}}, folder_ / "frames", progress_);
  }
  test::TemporaryFolder folder_;
  NoProgress progress_;
};

TEST_F(ImportVideo, TakesAFrameEverySoOften) {
  const VideoFrames frames = unpack(video(), 0.6);
  EXPECT_EQ(frames.size.width, 64);
  ASSERT_EQ(frames.frames.size(), 4U);
  for (std::size_t i = 0; i < 4; ++i) {
    EXPECT_NEAR(frames.frames[i].time_s, 0.6 * static_cast<double>(i), 1e-3);
    const cv::Mat grey = read_frame_file(folder_ / "frames" / frames.frames[i].name, Colour::grey);
    EXPECT_NEAR(grey.at<std::uint8_t>(24, 32), 20 + 60 * static_cast<int>(i), 6);
  }
  EXPECT_EQ(frames.frames[1].name, "flight_00000600.jpg");
}

TEST_F(ImportVideo, WhatIsNoVideoIsNamed) {
  EXPECT_THROW(unpack(folder_ / "absent.mp4", 1), UsageError);
  EXPECT_THROW(unpack(folder_.path(), 1), UsageError);
  EXPECT_THROW(unpack(folder_.write("text.mp4", "no video"), 1), UsageError);
  try {
    unpack_video({video(), 1, {folder_.path()}}, folder_.path(), progress_);
    FAIL();
  } catch (const UsageError& error) {
    EXPECT_THAT(error.what(), ::testing::HasSubstr("ffmpeg"));
  }
}

TEST_F(ImportVideo, ATruncatedVideoGivesWhatItHolds) {
  const auto file = video();
  const Bytes whole = read_file(file);
  for (std::size_t size = 0; size < whole.size(); size += 500) {
    std::filesystem::remove_all(folder_ / "frames");
    const auto cut = folder_.write("cut.avi", as_text(ByteView(whole).first(size)));
    try {
      EXPECT_LE(unpack(cut, 0.2).frames.size(), 10U);
    } catch (const UsageError&) {
    }
  }
}

}  // namespace
}  // namespace nadir
