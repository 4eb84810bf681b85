#include "ortho/tile_mosaic.hpp"

#include <gtest/gtest.h>

#include <opencv2/imgproc.hpp>

#include "vision/synthetic_ground.hpp"

namespace nadir {
namespace {

constexpr int kSide = 256;

// The waves of the synthetic ground at 0.4 m a pixel, moved by so many pixels.
cv::Mat picture(double dx, double dy, double contrast = 1) {
  cv::Mat colour(kSide, kSide, CV_8UC3);
  for (int r = 0; r < kSide; ++r) {
    for (int c = 0; c < kSide; ++c) {
      const double grey = 128 + contrast * (test::waves({0.4 * (c - dx), 0.4 * (r - dy)}) - 128);
      colour.at<cv::Vec3b>(r, c) = cv::Vec3b::all(cv::saturate_cast<std::uint8_t>(grey));
    }
  }
  return colour;
}

cv::Mat band(int from, int to) {
  cv::Mat mask = cv::Mat::zeros(kSide, kSide, CV_8UC1);
  mask.colRange(from, to).setTo(255);
  return mask;
}

TEST(Seam, TellsHowFarApartTwoPicturesLie) {
  for (const auto& [dx, dy] : {std::pair{0.0, 0.0}, {3.0, -2.0}, {0.5, 1.5}, {-4.0, 4.0}}) {
    const auto seam = measure_seam(picture(0, 0), picture(dx, dy), band(100, 180), 6);
    ASSERT_TRUE(seam);
    EXPECT_NEAR(seam->shift_px, std::hypot(dx, dy), 0.15);
    EXPECT_GT(seam->correlation, 0.97);
  }
}

TEST(Seam, LightDoesNotMatter) {
  const auto seam = measure_seam(picture(0, 0), picture(2, 0, 0.4), band(0, 256), 6);
  ASSERT_TRUE(seam);
  EXPECT_NEAR(seam->shift_px, 2, 0.15);
}

TEST(Seam, LooksOnlyWhereBothShowTheGround) {
  cv::Mat other = picture(1, 0);
  other.colRange(0, 90).setTo(cv::Scalar::all(0));
  other.colRange(180, kSide).setTo(cv::Scalar::all(255));
  const auto seam = measure_seam(picture(0, 0), other, band(90, 180), 6);
  ASSERT_TRUE(seam);
  EXPECT_NEAR(seam->shift_px, 1, 0.15);
  EXPECT_GT(seam->correlation, 0.97);
}

TEST(Seam, TooLittleInCommonSaysNothing) {
  EXPECT_FALSE(measure_seam(picture(0, 0), picture(0, 0), band(100, 130), 6));
  EXPECT_FALSE(measure_seam(picture(0, 0), picture(0, 0), cv::Mat::zeros(kSide, kSide, CV_8UC1), 6));
}

TEST(Seam, FlatAndStrangePicturesAgreeWithNothing) {
  const cv::Mat flat(kSide, kSide, CV_8UC3, cv::Scalar::all(90));
  for (const auto& [one, other] : {std::pair{flat, flat}, {flat, picture(0, 0)}, {picture(0, 0), flat}}) {
    const auto seam = measure_seam(one, other, band(0, 256), 6);
    ASSERT_TRUE(seam);
    EXPECT_LT(seam->correlation, 0.5);
  }
  cv::Mat noise(kSide, kSide, CV_8UC3);
  cv::RNG(5).fill(noise, cv::RNG::UNIFORM, 0, 256);
  EXPECT_LT(measure_seam(picture(0, 0), noise, band(0, 256), 6)->correlation, 0.5);
}

}  // namespace
}  // namespace nadir
