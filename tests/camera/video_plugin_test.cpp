// The real plug-in with a real recording, where OpenCV's videoio is installed.
#include <gtest/gtest.h>

#include <opencv2/core.hpp>
#include <opencv2/videoio.hpp>

#include "camera/open_camera.hpp"
#include "service/manual_clock.hpp"
#include "support/temporary_folder.hpp"

namespace nadir {
namespace {

using namespace std::chrono_literals;

TEST(VideoPlugin, PlaysARecordingToItsEnd) {
  const test::TemporaryFolder folder;
  const std::string file = (folder / "flight.avi").string();
  {
    cv::VideoWriter writer(file, cv::CAP_OPENCV_MJPEG, cv::VideoWriter::fourcc('M', 'J', 'P', 'G'), 5, {64, 48});
    ASSERT_TRUE(writer.isOpened());
    for (int i = 0; i < 4; ++i) writer.write(cv::Mat(48, 64, CV_8UC3, cv::Scalar::all(40 + 50 * i)));
  }
  ManualClock clock;
  const auto camera = open_camera("video:" + file, clock, {PLUGIN_FOLDER});
  const double start_s = clock.monotonic_s();
  for (int i = 0; i < 4; ++i) {
    CameraReading reading = camera->next(0ms, {});
    ASSERT_NE(reading.news, CameraNews::ended) << i;
    if (reading.news == CameraNews::nothing) {
      clock.advance(0.2001);
      reading = camera->next(0ms, {});
    }
    ASSERT_EQ(reading.news, CameraNews::frame) << reading.detail;
    ASSERT_TRUE(reading.frame.raw);
    EXPECT_EQ(reading.frame.raw->width, 64);
    EXPECT_EQ(reading.frame.bytes.size(), 64U * 48 * 3);
    EXPECT_NEAR(reading.frame.bytes[64 * 24 * 3], 40 + 50 * i, 6);
    EXPECT_NEAR(reading.frame.time_s - start_s, 0.2 * i, 0.01);
  }
  EXPECT_EQ(camera->next(0ms, {}).news, CameraNews::ended);
}

TEST(VideoPlugin, WhatIsNoVideoIsTrouble) {
  const test::TemporaryFolder folder;
  ManualClock clock;
  for (const auto& file : {folder.write("text.avi", "no video"), folder / "missing.avi"}) {
    EXPECT_EQ(open_camera("video:" + file.string(), clock, {PLUGIN_FOLDER})->next(0ms, {}).news, CameraNews::trouble);
  }
}

}  // namespace
}  // namespace nadir
