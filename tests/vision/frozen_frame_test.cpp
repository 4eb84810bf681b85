#include "vision/frozen_frame.hpp"

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

TEST(FrozenFrame, TheSameBitsAgainAreFrozen) {
  FrozenFrame frozen;
  EXPECT_FALSE(frozen.again(noise(1)));
  EXPECT_TRUE(frozen.again(noise(1)));
  EXPECT_TRUE(frozen.again(noise(1)));
  EXPECT_FALSE(frozen.again(noise(2)));
  EXPECT_FALSE(frozen.again(noise(1))) << "seen before, but not just now";
}

TEST(FrozenFrame, OneBitAnywhereMakesItAnother) {
  for (const cv::Point at : {cv::Point(0, 0), cv::Point(82, 60), cv::Point(80, 30), cv::Point(7, 59)}) {
    FrozenFrame frozen;
    cv::Mat picture = noise(3);
    frozen.again(picture);
    picture.at<std::uint8_t>(at) ^= 1;
    EXPECT_FALSE(frozen.again(picture)) << at;
  }
}

TEST(FrozenFrame, SeesRowsThatAreNotContinuous) {
  const cv::Mat large = noise(4, CV_8UC3);
  FrozenFrame frozen;
  frozen.again(large(cv::Rect(5, 5, 40, 40)));
  EXPECT_TRUE(frozen.again(large(cv::Rect(5, 5, 40, 40)).clone()));
}

TEST(FrozenFrame, EmptyIsNever) {
  FrozenFrame frozen;
  EXPECT_FALSE(frozen.again(cv::Mat()));
  EXPECT_FALSE(frozen.again(cv::Mat()));
}

}  // namespace
}  // namespace nadir
