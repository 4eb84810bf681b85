#include "vision/camera_frame.hpp"

#include <gtest/gtest.h>

#include <opencv2/core.hpp>

namespace nadir {
namespace {

cv::Mat noise(int seed, int type = CV_8UC1) {
  cv::RNG random(static_cast<std::uint64_t>(seed));
  cv::Mat picture(61, 83, type);
  random.fill(picture, cv::RNG::UNIFORM, 0, 256);
  return picture;
}

TEST(FrozenFrameDetector, TheSameBitsAgainAreFrozen) {
  FrozenFrameDetector frozen;
  EXPECT_FALSE(frozen.again(noise(1)));
  EXPECT_TRUE(frozen.again(noise(1)));
  EXPECT_TRUE(frozen.again(noise(1)));
  EXPECT_FALSE(frozen.again(noise(2)));
  EXPECT_FALSE(frozen.again(noise(1))) << "seen before, but not just now";
}

TEST(FrozenFrameDetector, OneBitAnywhereMakesItAnother) {
  for (const cv::Point at : {cv::Point(0, 0), cv::Point(82, 60), cv::Point(80, 30), cv::Point(7, 59)}) {
    FrozenFrameDetector frozen;
    cv::Mat picture = noise(3);
    frozen.again(picture);
    picture.at<std::uint8_t>(at) ^= 1;
    EXPECT_FALSE(frozen.again(picture)) << at;
  }
}

TEST(FrozenFrameDetector, SeesRowsThatAreNotContinuous) {
  const cv::Mat large = noise(4, CV_8UC3);
  FrozenFrameDetector frozen;
  frozen.again(large(cv::Rect(5, 5, 40, 40)));
  EXPECT_TRUE(frozen.again(large(cv::Rect(5, 5, 40, 40)).clone()));
}

TEST(FrozenFrameDetector, EmptyIsNever) {
  FrozenFrameDetector frozen;
  EXPECT_FALSE(frozen.again(cv::Mat()));
  EXPECT_FALSE(frozen.again(cv::Mat()));
}

}  // namespace
}  // namespace nadir
