#include "vision/quantized_channels.hpp"

#include <gtest/gtest.h>

#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

#include "vision/correlation.hpp"
#include "vision/synthetic_ground.hpp"

namespace nadir {
namespace {

constexpr ChannelSet kSix = ChannelSet::six_orientations;

cv::Mat quantized_picture() { return test::Landscape(3, 60).map(0.5).image; }  // 240 x 240

double correlation_of(const QuantizedChannels& one, const QuantizedChannels& other, std::size_t channel) {
  double product = 0, first = 0, second = 0;
  for (int r = 0; r < one.size().height; ++r) {
    for (int c = 0; c < one.size().width; ++c) {
      const double a = one.at(r, c)[channel], b = other.at(r, c)[channel];
      product += a * b, first += a * a, second += b * b;
    }
  }
  return product / std::sqrt(first * second);
}

// Two ways to the same channels: the smoothing's weights differ a little, the channels hardly.
TEST(QuantizedChannels, OfAPictureAreThoseOfItsChannels) {
  const cv::Mat image = quantized_picture();
  cv::Mat mask(image.size(), CV_8UC1, cv::Scalar(255));
  cv::fillConvexPoly(mask, std::vector<cv::Point>{{0, 0}, {60, 0}, {0, 130}}, cv::Scalar(0));
  for (const cv::Mat& valid : {cv::Mat(), mask}) {
    const QuantizedChannels direct = quantized_channels(image, valid, kSix);
    const QuantizedChannels rounded(oriented_channels(image, valid, kSix));
    ASSERT_EQ(direct.size(), rounded.size());
    EXPECT_EQ(cv::norm(direct.mask(), rounded.mask(), cv::NORM_INF), 0);
    for (std::size_t k = 0; k < 6; ++k) EXPECT_GT(correlation_of(direct, rounded, k), 0.985) << k;
  }
}

TEST(QuantizedChannels, OtherSetsAndOptionsAreRounded) {
  const cv::Mat image = quantized_picture();
  ChannelOptions smoother;
  smoother.sigma_px = 1.5;
  const QuantizedChannels found = quantized_channels(image, {}, kSix, smoother);
  const QuantizedChannels expected(oriented_channels(image, {}, kSix, smoother));
  for (int r = 0; r < 240; ++r) {
    for (int i = 0; i < 6 * 240; ++i) ASSERT_EQ(found.at(r, 0)[i], expected.at(r, 0)[i]);
  }
  EXPECT_EQ(quantized_channels(image, {}, ChannelSet::double_angle).channels(), 2U);
}

TEST(QuantizedChannels, AreInvariantToContrastReversal) {
  const cv::Mat image = quantized_picture();
  const QuantizedChannels one = quantized_channels(image, {}, kSix), other = quantized_channels(255 - image, {}, kSix);
  int largest = 0, worst = 0;
  for (int r = 0; r < 240; ++r) {
    for (int i = 0; i < 6 * 240; ++i) {
      largest = std::max(largest, std::abs(int{one.at(r, 0)[i]}));
      worst = std::max(worst, std::abs(one.at(r, 0)[i] - other.at(r, 0)[i]));
    }
  }
  EXPECT_GT(largest, 100);
  EXPECT_LE(worst, 8);  // 1/32 of a grey level is rounded upwards in both
}

// What lies beyond the mask must not leak in.
TEST(QuantizedChannels, TheMaskedBorderIsExcluded) {
  const cv::Mat image = quantized_picture();
  cv::Mat mask(image.size(), CV_8UC1, cv::Scalar(0)), other = image.clone();
  mask(cv::Rect(40, 30, 150, 160)).setTo(255);
  other.setTo(cv::Scalar(7), mask == 0);
  const QuantizedChannels one = quantized_channels(image, mask, kSix), two = quantized_channels(other, mask, kSix);
  for (int r = 0; r < 240; ++r) {
    for (int i = 0; i < 6 * 240; ++i) ASSERT_EQ(one.at(r, 0)[i], two.at(r, 0)[i]) << r << ' ' << i;
    for (int c = 0; c < 240; ++c) {
      if (one.mask().at<std::uint8_t>(r, c) != 0) continue;
      for (int k = 0; k < 6; ++k) ASSERT_EQ(one.at(r, c)[k], 0);
    }
  }
  EXPECT_EQ(cv::countNonZero(one.mask()), 144 * 154);
}

TEST(QuantizedChannels, BlankAndTinyPicturesHaveNoStructure) {
  for (const cv::Size size : {cv::Size(50, 40), cv::Size(2, 2), cv::Size(1, 30), cv::Size(3, 1)}) {
    const QuantizedChannels blank = quantized_channels(cv::Mat(size, CV_8UC1, cv::Scalar(90)), {}, kSix);
    for (int r = 0; r < size.height; ++r) {
      for (int i = 0; i < 6 * size.width; ++i) ASSERT_EQ(blank.at(r, 0)[i], 0);
    }
  }
}

TEST(QuantizedChannels, HalvesAreMeansOfFour) {
  cv::Mat mask(quantized_picture().size(), CV_8UC1, cv::Scalar(255));
  mask(cv::Rect(0, 0, 61, 33)).setTo(0);
  for (const cv::Mat& valid : {cv::Mat(), mask}) {
    const QuantizedChannels whole = quantized_channels(quantized_picture(), valid, kSix);
    for (const cv::Point first : {cv::Point(0, 0), cv::Point(1, 0), cv::Point(1, 1)}) {
      const QuantizedChannels half = whole.halved(first);
      ASSERT_EQ(half.size(), cv::Size((240 - first.x) / 2, (240 - first.y) / 2));
      for (int r = 0; r < half.size().height; ++r) {
        for (int c = 0; c < half.size().width; ++c) {
          const int y = 2 * r + first.y, x = 2 * c + first.x;
          const bool shown = cv::countNonZero(whole.mask()(cv::Rect(x, y, 2, 2))) == 4;
          ASSERT_EQ(half.mask().at<std::uint8_t>(r, c) != 0, shown);
          for (int k = 0; k < 6; ++k) {
            const int sum =
                whole.at(y, x)[k] + whole.at(y, x + 1)[k] + whole.at(y + 1, x)[k] + whole.at(y + 1, x + 1)[k];
            ASSERT_EQ(half.at(r, c)[k], shown ? (sum + 2) >> 2 : 0) << r << ' ' << c;
          }
        }
      }
    }
  }
}

}  // namespace
}  // namespace nadir
