// The real plug-in with real pipelines, where GStreamer is installed.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <opencv2/core.hpp>

#include "camera/camera_source.hpp"
#include "imagery/codecs.hpp"
#include "service/clock.hpp"
#include "support/temporary_folder.hpp"

namespace nadir {
namespace {

using namespace std::chrono_literals;
using ::testing::HasSubstr;

const SystemFlightClock& clock() {
  static const SystemFlightClock system;
  return system;
}

std::unique_ptr<CameraSource> pipeline(const std::string& description) {
  return open_camera("gstreamer:" + description, clock(), {PLUGIN_FOLDER});
}

// The next reading other than a timeout, however long it takes: the test's time limit ends a hang.
CameraReading news_of(CameraSource& camera) {
  CameraReading reading;
  while (reading.status == CameraStatus::timeout) reading = camera.next(100ms, {});
  return reading;
}

// 62 pixels: rows of grey and of BGR that are padded.
constexpr const char* kTestCamera =
    "videotestsrc is-live=true pattern=%s ! video/x-raw,format=%f,width=62,height=48,framerate=20/1";

std::string test_camera(const std::string& pattern, const std::string& format) {
  std::string text = kTestCamera;
  text.replace(text.find("%s"), 2, pattern);
  return text.replace(text.find("%f"), 2, format);
}

TEST(GstreamerPlugin, DeliversWhatThePipelineShowsWithoutThePaddingOfRows) {
  struct Shown {
    const char* pattern;
    const char* format;
    int channels;
    std::array<int, 3> bgr;
  };
  for (const Shown& shown : {Shown{"red", "BGR", 3, {0, 0, 255}}, Shown{"blue", "I420", 3, {255, 0, 0}},
                             Shown{"white", "GRAY8", 1, {235, 235, 235}}}) {
    const auto camera = pipeline(test_camera(shown.pattern, shown.format));
    for (int i = 0; i < 2; ++i) {
      const CameraReading reading = news_of(*camera);
      ASSERT_EQ(reading.status, CameraStatus::frame) << reading.detail;
      ASSERT_TRUE(reading.frame.raw);
      EXPECT_EQ(reading.frame.raw->width, 62);
      EXPECT_EQ(reading.frame.raw->height, 48);
      ASSERT_EQ(reading.frame.raw->channels, shown.channels) << shown.format;
      const auto channels = static_cast<std::size_t>(shown.channels);
      ASSERT_EQ(reading.frame.bytes.size(), 62 * 48 * channels);
      int worst = 0;
      for (std::size_t at = 0; at < reading.frame.bytes.size(); ++at) {
        worst = std::max(worst, std::abs(reading.frame.bytes[at] - shown.bgr.at(at % channels)));
      }
      EXPECT_LE(worst, 12) << shown.pattern << " as " << shown.format;
    }
  }
}

// The element after the camera's stamp keeps every frame for a tenth of a second: so old is each at least.
TEST(GstreamerPlugin, SaysHowOldAFrameIsByTheStampOfItsCamera) {
  const auto camera = pipeline(test_camera("ball", "GRAY8") + " ! queue ! identity sleep-time=100000");
  double last_s = 0;
  for (int i = 0; i < 4; ++i) {
    const CameraReading reading = news_of(*camera);
    ASSERT_EQ(reading.status, CameraStatus::frame) << reading.detail;
    ASSERT_TRUE(reading.frame.age_s);
    EXPECT_GE(*reading.frame.age_s, 0.1);
    const double captured_s = reading.frame.time_s - *reading.frame.age_s;
    EXPECT_GT(captured_s, last_s);
    last_s = captured_s;
  }
}

TEST(GstreamerPlugin, PicturesThatAreEncodedAlreadyArePassedOn) {
  const test::TemporaryFolder folder;
  const cv::Mat grey(48, 64, CV_8UC1, cv::Scalar::all(130));
  const Bytes jpeg = encode_image(grey, ImageFormat::jpeg, 90);
  const auto file = folder.write("frame.jpg", as_text(jpeg));
  const auto camera = pipeline("filesrc location=" + file.string() + " blocksize=1000000 ! typefind ! image/jpeg");
  const CameraReading reading = news_of(*camera);
  ASSERT_EQ(reading.status, CameraStatus::frame) << reading.detail;
  EXPECT_FALSE(reading.frame.raw);
  EXPECT_EQ(reading.frame.bytes, jpeg);
  EXPECT_FALSE(reading.frame.age_s) << "a file is nothing live";
}

TEST(GstreamerPlugin, APipelineThatEndsIsAFailureAndIsOpenedAgain) {
  const auto camera = pipeline("videotestsrc is-live=true num-buffers=2 ! video/x-raw,format=GRAY8,width=64,height=48");
  int frames = 0;
  CameraReading reading = news_of(*camera);
  for (; reading.status == CameraStatus::frame; reading = news_of(*camera)) ++frames;
  EXPECT_GE(frames, 1);
  EXPECT_EQ(reading.status, CameraStatus::failure);
  EXPECT_THAT(reading.detail, HasSubstr("the pipeline has ended"));
  EXPECT_EQ(news_of(*camera).status, CameraStatus::frame);
}

TEST(GstreamerPlugin, WhatIsNoPipelineIsAFailureThatSaysWhy) {
  const std::vector<std::pair<std::string, std::string>> wrong = {
      {"nosuchcamera ! video/x-raw", "nosuchcamera"},
      {"", "cannot open gstreamer:"},
      {"videotestsrc !", "cannot open"},
      {"videotestsrc ! fakesink", "could not link"},
      {"videotestsrc ! video/x-raw,width=nonsense(", "cannot open"},
      {"filesrc location=/nowhere/frame.jpg ! image/jpeg", "/nowhere/frame.jpg"},
      {"audiotestsrc", "neither raw video nor JPEG"},
  };
  for (const auto& [description, says] : wrong) {
    const CameraReading reading = news_of(*pipeline(description));
    EXPECT_EQ(reading.status, CameraStatus::failure) << description;
    EXPECT_THAT(reading.detail, HasSubstr(says)) << description;
  }
}

}  // namespace
}  // namespace nadir
