#include "vision/camera_frame.hpp"

#include <gtest/gtest.h>

#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

#include "base/random.hpp"
#include "vision/synthetic_ground.hpp"

namespace nadir {
namespace {

cv::Mat normal() { return test::Landscape(8, 80).map(0.5).image; }  // 320 x 320

TEST(FrameQuality, NormalFramesAreUsable) {
  const FrameQuality quality = measure_frame_quality(normal());
  EXPECT_TRUE(quality.usable);
  EXPECT_NEAR(quality.mean, cv::mean(normal())[0], 0.5);
  cv::Mat large;
  cv::resize(normal(), large, {1600, 1600}, 0, 0, cv::INTER_CUBIC);
  const FrameQuality same = measure_frame_quality(large);
  EXPECT_TRUE(same.usable);
  EXPECT_NEAR(same.sharpness, quality.sharpness, 0.15 * quality.sharpness) << "the size does not matter";
}

TEST(FrameQuality, BlackAndWhiteAreUnusable) {
  for (const int grey : {0, 1, 128, 254, 255}) {
    EXPECT_FALSE(measure_frame_quality(cv::Mat(240, 320, CV_8UC1, cv::Scalar(grey))).usable) << grey;
  }
  EXPECT_FALSE(measure_frame_quality({}).usable);
  EXPECT_FALSE(measure_frame_quality(cv::Mat(1, 1, CV_8UC1, cv::Scalar(7))).usable);
  EXPECT_FALSE(measure_frame_quality(cv::Mat(2, 1000, CV_8UC1, cv::Scalar(7))).usable);
}

// A covered lens is black but for the sensor's noise.
TEST(FrameQuality, ACoveredLensIsUnusable) {
  cv::Mat dark(240, 320, CV_8UC1);
  Random random(1);
  for (int r = 0; r < dark.rows; ++r) {
    for (int c = 0; c < dark.cols; ++c) {
      dark.at<std::uint8_t>(r, c) = cv::saturate_cast<std::uint8_t>(random.normal(4, 3));
    }
  }
  EXPECT_FALSE(measure_frame_quality(dark).usable);
}

TEST(FrameQuality, OverexposedIsUnusable) {
  cv::Mat bright;
  normal().convertTo(bright, CV_8U, 2.0, 60);
  const FrameQuality quality = measure_frame_quality(bright);
  EXPECT_GT(quality.clipped_share, 0.6);
  EXPECT_FALSE(quality.usable);
}

TEST(FrameQuality, HazeIsUnusable) {
  cv::Mat haze;
  normal().convertTo(haze, CV_8U, 0.03, 170);
  EXPECT_FALSE(measure_frame_quality(haze).usable) << "a contrast of 1 grey level";
}

// Dusk: little light, and the sensor's noise.
TEST(FrameQuality, ADarkPictureIsUsable) {
  cv::Mat dusk = normal();
  Random random(1);
  for (int r = 0; r < dusk.rows; ++r) {
    for (int c = 0; c < dusk.cols; ++c) {
      auto& value = dusk.at<std::uint8_t>(r, c);
      value = cv::saturate_cast<std::uint8_t>(8 + 0.1 * value + random.normal(0, 3));
    }
  }
  const FrameQuality quality = measure_frame_quality(dusk);
  EXPECT_TRUE(quality.usable) << quality.contrast;
}

TEST(FrameQuality, HeavyBlurIsUnusable) {
  cv::Mat out_of_focus, shaken;
  cv::GaussianBlur(normal(), out_of_focus, {}, 60);
  cv::normalize(out_of_focus, out_of_focus, 20, 230, cv::NORM_MINMAX);
  EXPECT_FALSE(measure_frame_quality(out_of_focus).usable);
  cv::blur(normal(), shaken, {9, 1});
  EXPECT_TRUE(measure_frame_quality(shaken).usable) << "some motion blur is a normal frame";
  EXPECT_LT(measure_frame_quality(shaken).sharpness, measure_frame_quality(normal()).sharpness);
}

cv::Mat noise(int seed, int type = CV_8UC1) {
  cv::RNG random(static_cast<std::uint64_t>(seed));
  cv::Mat picture(61, 83, type);
  random.fill(picture, cv::RNG::UNIFORM, 0, 256);
  return picture;
}

TEST(FrozenFrameDetector, IdenticalFramesAreRepeats) {
  FrozenFrameDetector frozen;
  EXPECT_FALSE(frozen.repeats(noise(1)));
  EXPECT_TRUE(frozen.repeats(noise(1)));
  EXPECT_TRUE(frozen.repeats(noise(1)));
  EXPECT_FALSE(frozen.repeats(noise(2)));
  EXPECT_FALSE(frozen.repeats(noise(1))) << "seen before, but not just now";
}

TEST(FrozenFrameDetector, OneBitAnywhereMakesADifferentFrame) {
  for (const cv::Point at : {cv::Point(0, 0), cv::Point(82, 60), cv::Point(80, 30), cv::Point(7, 59)}) {
    FrozenFrameDetector frozen;
    cv::Mat picture = noise(3);
    frozen.repeats(picture);
    picture.at<std::uint8_t>(at) ^= 1;
    EXPECT_FALSE(frozen.repeats(picture)) << at;
  }
}

TEST(FrozenFrameDetector, HandlesRowsThatAreNotContinuous) {
  const cv::Mat large = noise(4, CV_8UC3);
  FrozenFrameDetector frozen;
  frozen.repeats(large(cv::Rect(5, 5, 40, 40)));
  EXPECT_TRUE(frozen.repeats(large(cv::Rect(5, 5, 40, 40)).clone()));
}

TEST(FrozenFrameDetector, EmptyFramesNeverRepeat) {
  FrozenFrameDetector frozen;
  EXPECT_FALSE(frozen.repeats(cv::Mat()));
  EXPECT_FALSE(frozen.repeats(cv::Mat()));
}

CameraModel camera_of(int width, int height) {
  CameraModel camera;
  camera.width = width;
  camera.height = height;
  return camera;
}

// A picture of another size was decoded first and compared afterwards.
TEST(CameraFrame, AFrameOfAnotherSizeIsNotDecoded) {
  const Bytes frame = encode_image(normal(), ImageFormat::jpeg);
  int looks = 0;
  const DecodeBudget counted{.limit_ms = 1'000, .clock = [&looks] {
                               ++looks;
                               return std::int64_t{0};
                             }};
  EXPECT_TRUE(decode_camera_frame(frame, camera_of(640, 480), 1, counted).empty());
  EXPECT_TRUE(decode_camera_frame(frame, camera_of(320, 320), 2, counted).empty());
  EXPECT_EQ(looks, 0) << "the header says it";
  EXPECT_EQ(decode_camera_frame(frame, camera_of(320, 320), 1, counted).size(), cv::Size(320, 320));
  EXPECT_EQ(decode_camera_frame(frame, camera_of(160, 160), 2, counted).size(), cv::Size(160, 160));
  EXPECT_GT(looks, 0);
}

TEST(CameraFrame, AFrameThatTakesTooLongIsDropped) {
  const Bytes frame = encode_image(normal(), ImageFormat::jpeg);
  std::int64_t now_ms = 0;
  const DecodeBudget slow{.limit_ms = 1'000, .clock = [&now_ms] { return now_ms += 600; }};
  EXPECT_TRUE(decode_camera_frame(frame, camera_of(320, 320), 1, slow).empty());
}

}  // namespace
}  // namespace nadir
