#include "vision/oriented_channels.hpp"

#include <gtest/gtest.h>

#include <opencv2/imgproc.hpp>

#include "vision/synthetic_ground.hpp"

namespace nadir {
namespace {

cv::Mat landscape_picture() { return test::Landscape(3, 60).map(0.5).image; }  // 240 x 240

double worst_difference(const cv::Mat& a, const cv::Mat& b) { return cv::norm(a, b, cv::NORM_INF); }

std::vector<cv::Mat> planes(const Channels& channels) {
  std::vector<cv::Mat> all;
  for (const cv::Mat& pair : channels.pairs) {
    cv::Mat parts[2];
    cv::split(pair, parts);
    all.push_back(parts[0]);
    all.push_back(parts[1]);
  }
  return all;
}

class BothSets : public testing::TestWithParam<ChannelSet> {};
INSTANTIATE_TEST_SUITE_P(OrientedChannels, BothSets,
                         testing::Values(ChannelSet::double_angle, ChannelSet::six_orientations));

TEST_P(BothSets, AreInvariantToContrastReversal) {
  const cv::Mat image = landscape_picture();
  const Channels one = oriented_channels(image, {}, GetParam());
  const Channels other = oriented_channels(255 - image, {}, GetParam());
  ASSERT_EQ(one.pairs.size(), GetParam() == ChannelSet::double_angle ? 1U : 3U);
  for (std::size_t i = 0; i < one.pairs.size(); ++i) {
    EXPECT_GT(cv::norm(one.pairs[i], cv::NORM_INF), 0.2);
    EXPECT_LT(worst_difference(one.pairs[i], other.pairs[i]), 1e-4);
  }
}

TEST_P(BothSets, NormaliseContrast) {
  const cv::Mat image = landscape_picture();
  cv::Mat dim;
  image.convertTo(dim, CV_8U, 0.5, 60);
  const Channels one = oriented_channels(image, {}, GetParam());
  const Channels other = oriented_channels(dim, {}, GetParam());
  for (std::size_t i = 0; i < one.pairs.size(); ++i) {
    EXPECT_LT(cv::norm(one.pairs[i], other.pairs[i]), 0.08 * cv::norm(one.pairs[i])) << "rounding alone";
  }
}

// A quarter turn of the image turns every orientation into its perpendicular: these share a pair and swap places.
TEST(OrientedChannels, AQuarterTurnPermutesTheChannels) {
  const cv::Mat image = landscape_picture();
  cv::Mat turned;
  cv::rotate(image, turned, cv::ROTATE_90_CLOCKWISE);
  const auto before = planes(oriented_channels(image, {}, ChannelSet::six_orientations));
  const auto after = planes(oriented_channels(turned, {}, ChannelSet::six_orientations));
  for (std::size_t pair = 0; pair < 3; ++pair) {
    for (std::size_t side = 0; side < 2; ++side) {
      cv::Mat expected;
      cv::rotate(before[2 * pair + (1 - side)], expected, cv::ROTATE_90_CLOCKWISE);
      EXPECT_LT(worst_difference(after[2 * pair + side], expected), 1e-4) << pair << " " << side;
    }
  }
  cv::Mat back;
  cv::rotate(oriented_channels(turned, {}, ChannelSet::double_angle).pairs[0], back, cv::ROTATE_90_COUNTERCLOCKWISE);
  EXPECT_LT(cv::norm(back + oriented_channels(image, {}, ChannelSet::double_angle).pairs[0], cv::NORM_INF), 1e-4);
}

// A border of known direction lights the channel of its gradient.
TEST(OrientedChannels, AnEdgeActivatesItsOrientation) {
  cv::Mat image(100, 100, CV_8UC1, cv::Scalar(60));
  image(cv::Rect(50, 0, 50, 100)).setTo(180);  // gradient along x: orientation 0
  const auto all = planes(oriented_channels(image, {}, ChannelSet::six_orientations));
  std::vector<double> strength;
  for (const cv::Mat& plane : all) strength.push_back(static_cast<double>(plane.at<float>(50, 50)));
  // Planes: 0, 90, 30, 120, 60, 150 degrees.
  EXPECT_GT(strength[0], 0.3);
  EXPECT_NEAR(strength[2], strength[0] / 4, 0.01 * strength[0]) << "30 degrees off: cos² 60°";
  EXPECT_NEAR(strength[5], strength[0] / 4, 0.01 * strength[0]) << "30 degrees off the other way";
  EXPECT_NEAR(strength[1] + strength[3] + strength[4], 0, 1e-5) << "60 and 90 degrees off";
}

// What lies beyond the mask must not leak in: two images that differ only there have the same channels.
TEST(OrientedChannels, TheMaskedBorderIsExcluded) {
  const cv::Mat image = landscape_picture();
  cv::Mat mask(image.size(), CV_8UC1, cv::Scalar(0));
  cv::circle(mask, {120, 120}, 80, cv::Scalar(255), cv::FILLED);
  cv::Mat other = image.clone();
  other.setTo(0, mask == 0);
  const Channels one = oriented_channels(image, mask, ChannelSet::six_orientations);
  const Channels two = oriented_channels(other, mask, ChannelSet::six_orientations);
  EXPECT_EQ(cv::countNonZero(one.mask & (mask == 0)), 0);
  EXPECT_LT(cv::countNonZero(one.mask), cv::countNonZero(mask)) << "eroded";
  EXPECT_GT(cv::countNonZero(one.mask), 0.8 * cv::countNonZero(mask));
  for (std::size_t i = 0; i < one.pairs.size(); ++i) {
    cv::Mat outside = one.pairs[i].clone();
    outside.setTo(cv::Scalar::all(0), one.mask);
    EXPECT_EQ(cv::norm(outside, cv::NORM_INF), 0.0);
    // The mean strength, and with it the floor, is taken inside; the black rim's smoothed edge reaches in a little.
    EXPECT_LT(worst_difference(one.pairs[i], two.pairs[i]), 0.06 * cv::norm(one.pairs[i], cv::NORM_INF));
  }
}

TEST(OrientedChannels, ABlankImageHasNoStructure) {
  const Channels flat = oriented_channels(cv::Mat(50, 60, CV_8UC1, cv::Scalar(90)), {}, ChannelSet::six_orientations);
  for (const cv::Mat& pair : flat.pairs) EXPECT_LT(cv::norm(pair, cv::NORM_INF), 1e-3);
  const cv::Mat nowhere(50, 60, CV_8UC1, cv::Scalar(0));
  const Channels masked = oriented_channels(nowhere, nowhere, ChannelSet::double_angle);
  EXPECT_EQ(cv::countNonZero(masked.mask), 0);
  EXPECT_TRUE(cv::checkRange(masked.pairs[0])) << "no NaN";
}

}  // namespace
}  // namespace nadir
