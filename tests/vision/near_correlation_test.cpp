#include "vision/correlation.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>


namespace nadir {
namespace {

cv::Mat noise(cv::Size size, std::uint64_t seed) {
  cv::Mat picture(size, CV_8UC1);
  cv::RNG(seed).fill(picture, cv::RNG::UNIFORM, 0, 256);
  cv::GaussianBlur(picture, picture, cv::Size(), 1.5);
  return picture;
}

// The sum as it is defined in correlation.hpp, in double precision, pixel by pixel.
double defined_score(const Channels& pattern, const Channels& window, cv::Point at) {
  double product = 0, pattern_energy = 0, window_energy = 0;
  for (std::size_t p = 0; p < pattern.pairs.size(); ++p) {
    for (int k = 0; k < 2; ++k) {
      double n = 0, t = 0, m = 0, tt = 0, mm = 0, tm = 0;
      for (int r = 0; r < pattern.mask.rows; ++r) {
        for (int c = 0; c < pattern.mask.cols; ++c) {
          if (pattern.mask.at<std::uint8_t>(r, c) == 0) continue;
          const double a = pattern.pairs[p].at<cv::Vec2f>(r, c)[k];
          const double b = window.pairs[p].at<cv::Vec2f>(at.y + r, at.x + c)[k];
          n += 1, t += a, m += b, tt += a * a, mm += b * b, tm += a * b;
        }
      }
      product += tm - t * m / n;
      pattern_energy += tt - t * t / n;
      window_energy += mm - m * m / n;
    }
  }
  return product / std::sqrt(pattern_energy * window_energy);
}

Channels cut(const Channels& channels, const cv::Rect& part) {
  Channels result;
  for (const cv::Mat& pair : channels.pairs) result.pairs.push_back(pair(part).clone());
  result.mask = channels.mask(part).clone();
  return result;
}

class NearCorrelation : public testing::Test {
 protected:
  NearCorrelation() {
    cv::Mat mask(90, 110, CV_8UC1, cv::Scalar(255));
    cv::line(mask, {0, 30}, {109, 70}, cv::Scalar(0), 5);  // rows of two runs
    mask.rowRange(0, 6).setTo(0);
    picture = oriented_channels(noise({110, 90}, 1), mask, ChannelSet::six_orientations);
    map = oriented_channels(noise({110, 90}, 1) * 0.6 + noise({110, 90}, 2) * 0.4, {}, ChannelSet::six_orientations);
  }

  Channels picture, map;
};

TEST_F(NearCorrelation, IsTheDefinedSum) {
  const QuantizedChannels whole_picture(picture), whole_map(map);
  const cv::Rect part(20, 10, 48, 40);
  const cv::Point first(16, 7);
  const cv::Mat scores = LocalTemplate(whole_picture, part).scores(whole_map, first, {9, 7});
  ASSERT_EQ(scores.size(), cv::Size(9, 7));
  const Channels pattern = cut(picture, part);
  for (int v = 0; v < 7; ++v) {
    for (int u = 0; u < 9; ++u) {
      const double expected = defined_score(pattern, map, first + cv::Point(u, v));
      EXPECT_NEAR(scores.at<float>(v, u), expected, 0.01) << u << ' ' << v;  // 1/256 steps
    }
  }
  const Peak peak = best_peak(scores);
  EXPECT_NEAR(peak.x, part.x - first.x, 0.5);
  EXPECT_NEAR(peak.y, part.y - first.y, 0.5);
}

TEST_F(NearCorrelation, AgreesWithTransforms) {
  const QuantizedChannels whole_picture(picture), whole_map(map);
  const cv::Rect part(30, 20, 40, 44), wide(25, 14, 52, 56);
  const Channels pattern = cut(picture, part);
  const WindowSpectra window(cut(map, wide));
  const cv::Mat expected = correlate(pattern, window, TemplateNorm(pattern, window));
  const cv::Mat scores = LocalTemplate(whole_picture, part).scores(whole_map, wide.tl(), expected.size());
  EXPECT_LT(cv::norm(scores, expected, cv::NORM_INF), 0.01);
}

TEST_F(NearCorrelation, StepsAreAPartOfAllPlacements) {
  const QuantizedChannels whole_picture(picture), whole_map(map);
  const LocalTemplate pattern(whole_picture, {20, 10, 48, 40});
  const cv::Mat all = pattern.scores(whole_map, {12, 6}, {11, 9}),
                some = pattern.scores(whole_map, {12, 6}, {4, 3}, 0.6, 3);
  for (int v = 0; v < 3; ++v) {
    for (int u = 0; u < 4; ++u) EXPECT_EQ(some.at<float>(v, u), all.at<float>(3 * v, 3 * u));
  }
}

// What lies off the map counts as its mean, as in correlation.cpp.
TEST_F(NearCorrelation, AgreesWithTransformsBesideGapsOfTheMap) {
  Channels torn = map;
  torn.mask = map.mask.clone();
  torn.mask(cv::Rect(40, 0, 40, 60)).setTo(0);
  for (cv::Mat& pair : torn.pairs) {
    pair = pair.clone();
    pair.setTo(cv::Scalar::all(0), torn.mask == 0);
  }
  const QuantizedChannels whole_map(map), whole_torn(torn);
  const cv::Rect part(30, 20, 40, 44);
  const Channels pattern = cut(map, part);
  const WindowSpectra window(torn);
  for (const double min_valid : {0.2, 0.6}) {
    const cv::Mat expected = correlate(pattern, window, TemplateNorm(pattern, window, min_valid));
    const cv::Mat scores = LocalTemplate(whole_map, part).scores(whole_torn, {0, 0}, expected.size(), min_valid);
    int differ = 0, left_out = 0;
    for (int v = 0; v < scores.rows; ++v) {
      for (int u = 0; u < scores.cols; ++u) {
        const float a = scores.at<float>(v, u), b = expected.at<float>(v, u);
        if (a == -1) ++left_out;
        if (std::abs(a - b) > 0.01F) ++differ;  // rounding of transforms may miss the bound by a pixel
      }
    }
    EXPECT_GT(left_out, 50);
    EXPECT_LT(differ, 0.01 * static_cast<double>(scores.total())) << min_valid;
  }
}

TEST_F(NearCorrelation, WhatHasNoTextureMatchesNothing) {
  const Channels flat = oriented_channels(cv::Mat(60, 60, CV_8UC1, cv::Scalar(90)), {}, ChannelSet::six_orientations);
  const QuantizedChannels whole_flat(flat), whole_map(map);
  const cv::Mat on_flat = LocalTemplate(whole_map, {5, 5, 48, 48}).scores(whole_flat, {2, 2}, {5, 5});
  const cv::Mat of_flat = LocalTemplate(whole_flat, {5, 5, 48, 48}).scores(whole_map, {2, 2}, {5, 5});
  EXPECT_EQ(cv::countNonZero(on_flat != -1), 0);
  EXPECT_EQ(cv::countNonZero(of_flat != 0), 0);
  Channels none = map;
  none.mask = cv::Mat::zeros(map.mask.size(), CV_8UC1);
  const QuantizedChannels whole_none(none);
  EXPECT_EQ(cv::countNonZero(LocalTemplate(whole_none, {5, 5, 48, 48}).scores(whole_map, {2, 2}, {5, 5}) != -1), 0);
}

}  // namespace
}  // namespace nadir
