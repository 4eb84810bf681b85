#include "vision/feature_matching.hpp"

#include <gtest/gtest.h>

#include <opencv2/core.hpp>
#include <opencv2/features2d.hpp>

namespace nadir {
namespace {

cv::Mat random_descriptors(int count, std::uint64_t seed) {
  cv::Mat bytes(count, 128, CV_8UC1), rows;
  cv::RNG(seed).fill(bytes, cv::RNG::UNIFORM, 0, 256);
  bytes.convertTo(rows, CV_32F);
  return rows;
}

TEST(FeatureMatching, AgreesWithOpencvBruteForce) {
  const cv::Mat now = random_descriptors(90, 1);
  cv::Mat before = random_descriptors(70, 2);
  for (int i = 0; i < 40; ++i) before.row(i) = 0.9 * now.row(2 * i) + 0.1 * before.row(i);  // alike, at other places
  before.forEach<float>([](float& value, const int*) { value = std::round(value); });

  std::vector<std::vector<cv::DMatch>> expected;
  cv::BFMatcher(cv::NORM_L2).knnMatch(now, before, expected, 2);
  const auto found = unambiguous_matches(FeatureDescriptors(now), FeatureDescriptors(before), 0.85);
  std::size_t next = 0;
  for (const auto& pair : expected) {
    if (pair[0].distance >= 0.85F * pair[1].distance) continue;
    ASSERT_LT(next, found.size());
    EXPECT_EQ(found[next].first, static_cast<std::size_t>(pair[0].queryIdx));
    EXPECT_EQ(found[next].second, static_cast<std::size_t>(pair[0].trainIdx));
    ++next;
  }
  EXPECT_EQ(next, found.size());
  EXPECT_GE(found.size(), 40U);
}

TEST(FeatureMatching, TheLargestDistanceFits) {
  cv::Mat before(2, 128, CV_32FC1, cv::Scalar(255));
  before.row(1).setTo(254);
  const FeatureDescriptors dark(cv::Mat(1, 128, CV_32FC1, cv::Scalar(0)));
  const auto found = unambiguous_matches(dark, FeatureDescriptors(before), 0.9999);
  ASSERT_EQ(found.size(), 1U);
  EXPECT_EQ(found[0].second, 1U);
}

TEST(FeatureMatching, NoMatchWithoutASecondNearestNeighbour) {
  const FeatureDescriptors some(random_descriptors(5, 3)), one(random_descriptors(1, 4)), none{cv::Mat()};
  EXPECT_TRUE(unambiguous_matches(some, one, 0.85).empty());
  EXPECT_TRUE(unambiguous_matches(some, none, 0.85).empty());
  EXPECT_TRUE(unambiguous_matches(none, some, 0.85).empty());
}

}  // namespace
}  // namespace nadir
