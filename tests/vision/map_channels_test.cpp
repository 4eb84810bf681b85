// Channels of the map that serve more than one comparison: the same scores as channels made for each.
#include "vision/correlation.hpp"

#include <gtest/gtest.h>

#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

namespace nadir {
namespace {

constexpr ChannelSet kSet = ChannelSet::six_orientations;

cv::Mat noise(cv::Size size, std::uint64_t seed) {
  cv::Mat picture(size, CV_8UC1);
  cv::RNG(seed).fill(picture, cv::RNG::UNIFORM, 0, 256);
  cv::GaussianBlur(picture, picture, cv::Size(), 1.5);
  return picture;
}

class MapChannelsTest : public testing::Test {
 protected:
  cv::Mat image = noise({240, 200}, 1), mask{image.size(), CV_8UC1, cv::Scalar(255)};
  QuantizedChannels pattern{oriented_channels(image({100, 80, 60, 50}), {}, kSet)};

  // Of the pattern at the places up to 3 px around where it was cut out.
  cv::Mat scores(MapChannels& map) const {
    return LocalTemplate(pattern, cv::Rect(cv::Point(), pattern.size()))
        .scores(map.channels(), map.inside({97, 77}), {7, 7});
  }
};

TEST_F(MapChannelsTest, WhatIsCoveredMoreWidelyScoresTheSame) {
  MapChannels narrow(image, mask, kSet, {}), wide(image, mask, kSet, {});
  narrow.cover({97, 77, 66, 56});
  wide.cover({20, 20, 200, 160});
  const cv::Mat one = scores(narrow), other = scores(wide);
  EXPECT_LT(cv::norm(one, other, cv::NORM_INF), 0.03);  // the levelling sees another neighbourhood
  cv::Point best;
  cv::minMaxLoc(other, nullptr, nullptr, nullptr, &best);
  EXPECT_EQ(best, cv::Point(3, 3));
}

TEST_F(MapChannelsTest, ArePartlyMadeAnewOnlyWhenNeeded) {
  MapChannels map(image, mask, kSet, {});
  map.cover({50, 50, 120, 100});
  const QuantizedChannels* first = &map.channels();
  const cv::Mat first_mask = first->mask();
  map.cover({97, 77, 66, 56});    // inside
  map.cover({45, 45, 125, 100});  // a little beside
  EXPECT_EQ(map.channels().mask().data, first_mask.data);
  map.cover({97, 77, 140, 56});  // beyond
  EXPECT_NE(map.channels().mask().data, first_mask.data);
  EXPECT_GT(scores(map).at<float>(3, 3), 0.9F);
}

TEST_F(MapChannelsTest, BeyondTheMapNothingIsValid) {
  MapChannels map(image, mask, kSet, {});
  map.cover({-40, -30, 100, 90});
  const cv::Point corner = map.inside({0, 0});
  const cv::Mat& valid = map.channels().mask();
  EXPECT_EQ(cv::countNonZero(valid.rowRange(0, corner.y)), 0);
  EXPECT_EQ(cv::countNonZero(valid.colRange(0, corner.x)), 0);
  EXPECT_EQ(valid.at<std::uint8_t>(corner.y + 40, corner.x + 30), 255);
  map.cover({1000, 1000, 50, 50});  // nothing of it at all
  EXPECT_EQ(cv::countNonZero(map.channels().mask()), 0);
}

}  // namespace
}  // namespace nadir
