#include "vision/feature_descriptors.hpp"

#include <gtest/gtest.h>

#include <opencv2/core.hpp>
#include <opencv2/features2d.hpp>
#include <opencv2/imgproc.hpp>

#include "vision/feature_matching.hpp"
#include "vision/synthetic_ground.hpp"

namespace nadir {
namespace {

cv::Mat picture() { return test::Landscape(3, 90).map(0.5).image; }  // 360 x 360

std::vector<cv::KeyPoint> features_of(const cv::Mat& image) {
  std::vector<cv::KeyPoint> features;
  cv::SIFT::create(500, 3, 0.007)->detect(image, features);
  return features;
}

struct Tally {
  int matches = 0, right = 0;
};

// turned: maps the first picture onto the second.
Tally matched(const std::vector<cv::KeyPoint>& one, const cv::Mat& of_one, const std::vector<cv::KeyPoint>& two,
              const cv::Mat& of_two, const cv::Matx23d& turned) {
  Tally tally;
  for (const FeatureMatch& match : unambiguous_matches(FeatureDescriptors(of_one), FeatureDescriptors(of_two), 0.85)) {
    const cv::Point2f from = one[match.first].pt, to = two[match.second].pt;
    const cv::Point2d at(from.x, from.y);
    const double x = turned(0, 0) * at.x + turned(0, 1) * at.y + turned(0, 2) - static_cast<double>(to.x);
    const double y = turned(1, 0) * at.x + turned(1, 1) * at.y + turned(1, 2) - static_cast<double>(to.y);
    ++tally.matches;
    if (std::hypot(x, y) < 3) ++tally.right;
  }
  return tally;
}

// Turned, scaled, dimmed: as many are found again as with OpenCV's descriptors.
TEST(FeatureDescriptors, MatchAsWellAsThoseThatReadEveryPixel) {
  const cv::Mat image = picture();
  for (const double degrees : {0.0, 30.0, 90.0, 171.0}) {
    cv::Mat by = cv::getRotationMatrix2D({180, 180}, degrees, 0.92), other;
    cv::warpAffine(image, other, by, image.size(), cv::INTER_AREA, cv::BORDER_REFLECT);
    other.convertTo(other, CV_8U, 0.7, 20);
    const auto one = features_of(image), two = features_of(other);
    ASSERT_GT(one.size(), 100U);
    cv::Mat full_one, full_two;
    auto kept_one = one, kept_two = two;
    cv::SIFT::create()->compute(image, kept_one, full_one);
    cv::SIFT::create()->compute(other, kept_two, full_two);
    const cv::Matx23d turned(by);
    const Tally ours = matched(one, describe_features(image, one), two, describe_features(other, two), turned);
    const Tally full = matched(kept_one, full_one, kept_two, full_two, turned);
    EXPECT_GT(ours.right, 0.9 * full.right) << degrees;
    EXPECT_GT(ours.right, 0.9 * ours.matches * full.right / full.matches) << degrees;
  }
}

TEST(FeatureDescriptors, AreWholeNumbersOfOneByte) {
  const cv::Mat image = picture();
  const cv::Mat rows = describe_features(image, features_of(image));
  ASSERT_GT(rows.rows, 100);
  ASSERT_EQ(rows.cols, 128);
  for (int r = 0; r < rows.rows; ++r) {
    for (int c = 0; c < rows.cols; ++c) {
      const float value = rows.at<float>(r, c);
      ASSERT_TRUE(value >= 0 && value <= 255 && value == std::round(value)) << r << ' ' << c;
    }
  }
}

// Features at the border, of any size, and pictures without structure.
TEST(FeatureDescriptors, NothingIsReadBeyondThePicture) {
  const cv::Mat blank(40, 50, CV_8UC1, cv::Scalar(90));
  std::vector<cv::KeyPoint> features;
  for (const float size : {0.01F, 2.0F, 30.0F, 4000.0F}) {
    for (const cv::Point2f at : {cv::Point2f(0, 0), cv::Point2f(49, 39), cv::Point2f(25, 20)}) {
      features.emplace_back(at, size, 359.9F);
    }
  }
  EXPECT_EQ(cv::norm(describe_features(blank, features), cv::NORM_INF), 0);
  EXPECT_EQ(describe_features(blank, {}).rows, 0);
}

}  // namespace
}  // namespace nadir
