#include "vision/dense_descriptors.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <opencv2/core.hpp>

#include "base/error.hpp"
#include "vision/gradient_network.hpp"
#include "vision/synthetic_ground.hpp"

namespace nadir {
namespace {

using namespace test;
using testing::HasSubstr;

cv::Mat ground_picture(int rows, int columns) {
  static const Landscape landscape(5, 900);
  return landscape.map(1.0).image(cv::Rect(0, 0, columns, rows)).clone();
}

TEST(DenseDescriptors, AreUnitVectors) {
  GradientNetwork network;
  const DescribedPicture picture = described(network, ground_picture(100, 210), {});
  ASSERT_EQ(picture.cells.size(), cv::Size(26, 12));  // whole cells
  EXPECT_EQ(cv::countNonZero(picture.mask), 26 * 12);
  for (int r = 0; r < 12; ++r) {
    for (int c = 0; c < 26; ++c) {
      const auto* cell = picture.cells.ptr<float>(r) + c * 8;
      double squares = 0;
      for (int k = 0; k < 8; ++k) squares += static_cast<double>(cell[k] * cell[k]);
      EXPECT_NEAR(squares, 1, 1e-5);
    }
  }
}

TEST(DenseDescriptors, WhatIsMaskedIsNoCell) {
  GradientNetwork network;
  cv::Mat mask(96, 160, CV_8UC1, cv::Scalar(255));
  mask(cv::Rect(0, 0, 42, 96)).setTo(0);  // up to the sixth cell
  const DescribedPicture picture = described(network, ground_picture(96, 160), mask);
  for (int c = 0; c < 20; ++c) EXPECT_EQ(picture.mask.at<std::uint8_t>(5, c), c <= 6 ? 0 : 255) << c;
  EXPECT_EQ(picture.cells.ptr<float>(5)[3 * 8], 0);
  // What is masked does not matter.
  cv::Mat other = ground_picture(96, 160);
  other(cv::Rect(0, 0, 42, 96)).setTo(7);
  EXPECT_EQ(cv::norm(described(network, other, mask).cells, picture.cells, cv::NORM_INF), 0);
}

// Memory is bounded, and the seams of the parts are not seen.
TEST(DenseDescriptors, LargePicturesAreDescribedInParts) {
  GradientNetwork network;
  const cv::Mat large = ground_picture(300, 1700);
  const DescribedPicture picture = described(network, large, {});
  EXPECT_EQ(network.calls, 3);
  EXPECT_LE(network.largest_px, 896 * 320);
  const cv::Rect across(700, 0, 320, 300);  // the first seam lies in its middle
  const DescribedPicture part = described(network, large(across), {});
  const cv::Rect inside(4, 4, 32, 28);
  EXPECT_LT(cv::norm(part.cells(inside), picture.cells(inside + cv::Point(87, 0)), cv::NORM_INF), 2);
  EXPECT_LT(cv::norm(described(network, large(cv::Rect(696, 0, 320, 300)), {}).cells(inside),
                     picture.cells(inside + cv::Point(87, 0)), cv::NORM_INF),
            1e-3);
}

TEST(DenseDescriptors, NothingIsDescribedAsNothing) {
  GradientNetwork network;
  EXPECT_TRUE(described(network, ground_picture(7, 100), {}).cells.empty());
  const cv::Mat none(64, 64, CV_8UC1, cv::Scalar(0));
  EXPECT_EQ(cv::countNonZero(described(network, ground_picture(64, 64), none).mask), 0);
  EXPECT_EQ(network.calls, 0);
}

class WrongNetwork final : public DenseDescriptorNetwork {
 public:
  explicit WrongNetwork(cv::Mat result) : result_(std::move(result)) {}
  int channels() const override { return 4; }
  std::string name() const override { return "wrong"; }
  cv::Mat describe(const cv::Mat& /*grey*/) override { return result_; }

 private:
  cv::Mat result_;
};

std::string complaint(const cv::Mat& result) {
  WrongNetwork network(result);
  try {
    described(network, ground_picture(64, 64), {});
    return "accepted";
  } catch (const Error& error) {
    return error.what();
  }
}

TEST(DenseDescriptors, RejectsWhatANetworkMustNotGive) {
  EXPECT_EQ(complaint(cv::Mat(8, 8, CV_32FC4, cv::Scalar::all(1))), "accepted");
  EXPECT_EQ(complaint(cv::Mat(8, 8, CV_32FC4, cv::Scalar::all(0))), "accepted");  // a blank picture
  EXPECT_THAT(complaint(cv::Mat(8, 7, CV_32FC4, cv::Scalar::all(1))), HasSubstr("7 x 8 cells of 4"));
  EXPECT_THAT(complaint(cv::Mat(8, 8, CV_32FC3, cv::Scalar::all(1))), HasSubstr("cells of 3"));
  cv::Mat values(8, 8, CV_32FC4, cv::Scalar::all(1));
  values.at<cv::Vec4f>(7, 7)[3] = std::numeric_limits<float>::quiet_NaN();
  EXPECT_THAT(complaint(values), HasSubstr("NaN"));
  values.at<cv::Vec4f>(7, 7)[3] = std::numeric_limits<float>::infinity();
  EXPECT_THAT(complaint(values), HasSubstr("NaN or infinity"));
}

// Cells that differ along two directions: two principal channels keep all of their differences.
TEST(PrincipalChannels, KeepTheDirectionsThatDiffer) {
  cv::RNG random(7);
  DescribedPicture picture{cv::Mat(20, 30, CV_32FC(6)), cv::Mat(20, 30, CV_8UC1, cv::Scalar(255))};
  for (int i = 0; i < 600; ++i) {
    auto* cell = picture.cells.ptr<float>(i / 30) + (i % 30) * 6;
    const auto a = static_cast<float>(random.gaussian(1)), b = static_cast<float>(random.gaussian(0.5));
    const std::array<float, 6> values = {a, a + b, 3, -b, 1, a - b};
    std::copy(values.begin(), values.end(), cell);
  }
  const DescribedPicture two = PrincipalChannels(picture, 2).project(picture);
  ASSERT_EQ(two.cells.channels(), 2);
  for (int i = 1; i < 600; i += 37) {
    const auto *one = picture.cells.ptr<float>(0), *other = picture.cells.ptr<float>(i / 30) + (i % 30) * 6;
    const auto *kept = two.cells.ptr<float>(0), *other_kept = two.cells.ptr<float>(i / 30) + (i % 30) * 2;
    double apart = 0, kept_apart = 0;
    for (int k = 0; k < 6; ++k) apart += static_cast<double>((one[k] - other[k]) * (one[k] - other[k]));
    for (int k = 0; k < 2; ++k)
      kept_apart += static_cast<double>((kept[k] - other_kept[k]) * (kept[k] - other_kept[k]));
    EXPECT_NEAR(kept_apart, apart, 1e-4 + 1e-4 * apart);
  }
  EXPECT_EQ(PrincipalChannels(picture, 6).project(picture).cells.data, picture.cells.data);
}

TEST(PrincipalChannels, OfNoCellsAreTheChannelsThemselves) {
  const DescribedPicture none{cv::Mat::zeros(4, 4, CV_32FC(6)), cv::Mat::zeros(4, 4, CV_8UC1)};
  EXPECT_EQ(PrincipalChannels(none, 2).project(none).cells.channels(), 6);
}

TEST(DenseDescriptors, BecomePairsOfChannels) {
  DescribedPicture picture{cv::Mat(2, 3, CV_32FC(5), cv::Scalar(0)), cv::Mat(2, 3, CV_8UC1, cv::Scalar(255))};
  for (int k = 0; k < 5; ++k) picture.cells.ptr<float>(1)[2 * 5 + k] = static_cast<float>(k);
  const Channels channels = channels_of(picture);
  ASSERT_EQ(channels.pairs.size(), 3U);
  const float scale = parameters::learned_matching::kDescriptorScale;
  EXPECT_EQ(channels.pairs[1].at<cv::Vec2f>(1, 2), cv::Vec2f(2 * scale, 3 * scale));
  EXPECT_EQ(channels.pairs[2].at<cv::Vec2f>(1, 2), cv::Vec2f(4 * scale, 0));
}

}  // namespace
}  // namespace nadir
