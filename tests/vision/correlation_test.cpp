#include "vision/correlation.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <opencv2/imgproc.hpp>

#include "base/random.hpp"

namespace nadir {
namespace {

cv::Mat random_pair(Random& random, int columns, int rows) {
  cv::Mat pair(rows, columns, CV_32FC2);
  for (int r = 0; r < rows; ++r) {
    for (int c = 0; c < columns; ++c) {
      pair.at<cv::Vec2f>(r, c) = {static_cast<float>(random.normal(0.4, 1)),
                                  static_cast<float>(random.normal(-0.2, 0.7))};
    }
  }
  return pair;
}

Channels random_channels(Random& random, int columns, int rows, std::size_t pairs) {
  Channels channels;
  for (std::size_t i = 0; i < pairs; ++i) channels.pairs.push_back(random_pair(random, columns, rows));
  channels.mask = cv::Mat(rows, columns, CV_8UC1, cv::Scalar(255));
  return channels;
}

// A disc or a wedge of the picture is invalid, as with frames that are tilted and maps that end.
void punch(Channels& channels, const cv::Rect& hole) {
  channels.mask(hole).setTo(0);
  for (cv::Mat& pair : channels.pairs) pair(hole).setTo(cv::Scalar::all(0));
}

// The formula of the header, by loops. Where the map is missing, its centred value counts as 0 (the mean of the whole
// window stands in for it) and the norm under the valid part is scaled to the whole template.
double direct_score(const Channels& pattern, const Channels& window, int x, int y, double min_valid) {
  const int columns = pattern.mask.cols, rows = pattern.mask.rows;
  double cross = 0, pattern_energy = 0, window_energy = 0;
  int area = 0, valid = 0;
  for (int r = 0; r < rows; ++r) {
    for (int c = 0; c < columns; ++c) {
      if (pattern.mask.at<std::uint8_t>(r, c) == 0) continue;
      ++area;
      if (window.mask.at<std::uint8_t>(y + r, x + c) != 0) ++valid;
    }
  }
  if (valid < min_valid * area) return -1;
  for (std::size_t i = 0; i < pattern.pairs.size(); ++i) {
    for (int part = 0; part < 2; ++part) {
      const auto value = [part](const cv::Mat& pair, int r, int c) {
        return static_cast<double>(pair.at<cv::Vec2f>(r, c)[part]);
      };
      double pattern_mean = 0, here_mean = 0, whole_mean = 0;
      int whole = 0;
      for (int r = 0; r < window.mask.rows; ++r) {
        for (int c = 0; c < window.mask.cols; ++c) {
          if (window.mask.at<std::uint8_t>(r, c) == 0) continue;
          whole_mean += value(window.pairs[i], r, c);
          ++whole;
        }
      }
      whole_mean /= whole;
      const auto visit = [&](auto&& each) {
        for (int r = 0; r < rows; ++r) {
          for (int c = 0; c < columns; ++c) {
            if (pattern.mask.at<std::uint8_t>(r, c) == 0) continue;
            each(value(pattern.pairs[i], r, c), window.mask.at<std::uint8_t>(y + r, x + c) != 0,
                 value(window.pairs[i], y + r, x + c));
          }
        }
      };
      visit([&](double t, bool known, double m) {
        pattern_mean += t / area;
        if (known) here_mean += m / valid;
      });
      visit([&](double t, bool known, double m) {
        pattern_energy += (t - pattern_mean) * (t - pattern_mean);
        if (!known) return;
        // With the whole map valid, whose mean is taken away makes no difference: the template's values sum to 0.
        const double centre = valid == area ? here_mean : whole_mean;
        cross += (t - pattern_mean) * (m - centre);
        window_energy += (m - here_mean) * (m - here_mean);
      });
    }
  }
  return cross / std::sqrt(pattern_energy * window_energy * area / valid);
}

double worst_difference(const Channels& pattern, const Channels& window, double min_valid) {
  const WindowSpectra spectra(window);
  const cv::Mat scores = correlate(pattern, spectra, TemplateNorm(pattern, spectra, min_valid));
  EXPECT_EQ(scores.size(),
            cv::Size(window.mask.cols - pattern.mask.cols + 1, window.mask.rows - pattern.mask.rows + 1));
  double worst = 0;
  for (int y = 0; y < scores.rows; ++y) {
    for (int x = 0; x < scores.cols; ++x) {
      const double expected = direct_score(pattern, window, x, y, min_valid);
      worst = std::max(worst, std::abs(static_cast<double>(scores.at<float>(y, x)) - expected));
    }
  }
  return worst;
}

TEST(Correlation, EqualsTheFormula) {
  Random random(11);
  for (const std::size_t pairs : {1U, 3U}) {
    const Channels window = random_channels(random, 40, 33, pairs);
    const Channels pattern = random_channels(random, 15, 12, pairs);
    EXPECT_LT(worst_difference(pattern, window, 0.6), 1e-4);
  }
}

TEST(Correlation, EqualsTheFormulaUnderATemplateMask) {
  Random random(12);
  const Channels window = random_channels(random, 37, 41, 3);
  Channels pattern = random_channels(random, 16, 14, 3);
  punch(pattern, {0, 0, 5, 14});
  punch(pattern, {9, 8, 7, 6});
  EXPECT_LT(worst_difference(pattern, window, 0.6), 1e-4);
}

TEST(Correlation, EqualsTheFormulaWhereTheMapEnds) {
  Random random(13);
  Channels window = random_channels(random, 44, 36, 3);
  punch(window, {28, 0, 16, 36});
  punch(window, {0, 30, 20, 6});
  Channels pattern = random_channels(random, 17, 13, 3);
  punch(pattern, {0, 0, 4, 4});
  EXPECT_LT(worst_difference(pattern, window, 0.6), 1e-4);
  EXPECT_LT(worst_difference(pattern, window, 0.15), 1e-4);
}

TEST(Correlation, TooLittleMapDoesNotCount) {
  Random random(14);
  Channels window = random_channels(random, 60, 20, 1);
  punch(window, {30, 0, 30, 20});
  const Channels pattern = random_channels(random, 20, 20, 1);
  const WindowSpectra spectra(window);
  const cv::Mat scores = correlate(pattern, spectra, TemplateNorm(pattern, spectra, 0.6));
  for (int x = 0; x < scores.cols; ++x) {
    const double share = std::clamp((30.0 - x) / 20, 0.0, 1.0);
    if (share < 0.59) {
      EXPECT_EQ(scores.at<float>(0, x), -1.0F) << x;
    }
    if (share > 0.61) {
      EXPECT_GT(scores.at<float>(0, x), -1.0F) << x;
    }
  }
}

TEST(Correlation, AWindowWithoutContentScoresNothing) {
  Random random(15);
  Channels flat = random_channels(random, 40, 40, 1);
  flat.pairs[0].setTo(cv::Scalar::all(0.3));
  const Channels pattern = random_channels(random, 20, 20, 1);
  const WindowSpectra spectra(flat);
  const cv::Mat scores = correlate(pattern, spectra, TemplateNorm(pattern, spectra));
  EXPECT_EQ(cv::countNonZero(scores == -1.0F), static_cast<int>(scores.total()));
  EXPECT_TRUE(distinct_peaks(scores, 5, 3).empty());
}

TEST(Correlation, FindsACutOutPiece) {
  Random random(16);
  const Channels window = random_channels(random, 50, 45, 3);
  Channels pattern;
  const cv::Rect part(17, 9, 20, 18);
  for (const cv::Mat& pair : window.pairs) pattern.pairs.push_back(pair(part) * 3.0 + cv::Scalar(0.5, -2));
  pattern.mask = window.mask(part).clone();
  const WindowSpectra spectra(window);
  const Peak peak = best_peak(correlate(pattern, spectra, TemplateNorm(pattern, spectra)));
  EXPECT_NEAR(peak.score, 1, 1e-4) << "gain and offset do not matter";
  EXPECT_NEAR(peak.x, 17, 0.2);
  EXPECT_NEAR(peak.y, 9, 0.2);
}

cv::Mat hills(const std::vector<std::array<double, 3>>& tops, cv::Size size) {
  cv::Mat scores(size, CV_32FC1);
  for (int r = 0; r < size.height; ++r) {
    for (int c = 0; c < size.width; ++c) {
      double sum = 0;
      for (const auto& [x, y, height] : tops) {
        sum += height * std::exp(-((c - x) * (c - x) + (r - y) * (r - y)) / (2 * 9.0));
      }
      scores.at<float>(r, c) = static_cast<float>(sum);
    }
  }
  return scores;
}

TEST(Peaks, BetweenThePixels) {
  for (const auto& [x, y] : {std::pair{20.3, 14.8}, std::pair{7.5, 22.1}, std::pair{31.0, 9.49}}) {
    const Peak peak = best_peak(hills({{x, y, 0.9}}, {40, 30}));
    EXPECT_NEAR(peak.x, x, 0.03);
    EXPECT_NEAR(peak.y, y, 0.03);
    EXPECT_NEAR(peak.curvature_x, 0.9 / 9, 0.01) << "−d²/dx² of the hill's top";
    EXPECT_NEAR(peak.curvature_y, 0.9 / 9, 0.01);
  }
}

TEST(Peaks, AtTheRimStaysInside) {
  const Peak peak = best_peak(hills({{-3, 29, 0.9}}, {40, 30}));
  EXPECT_EQ(peak.x, 0);
  EXPECT_EQ(peak.y, 29);
}

TEST(Peaks, DistinctOnesBestFirst) {
  const cv::Mat scores = hills({{10, 10, 0.5}, {30, 20, 0.9}, {50, 10, 0.7}, {36, 20, 0.6}}, {60, 30});
  const auto peaks = distinct_peaks(scores, 3, 10);
  ASSERT_EQ(peaks.size(), 3U);
  EXPECT_NEAR(peaks[0].x, 30, 2.0);
  EXPECT_NEAR(peaks[1].x, 50, 1.0) << "the hill at 36 belongs to the one at 30";
  EXPECT_GT(peaks[0].score, peaks[1].score);
  EXPECT_GT(peaks[1].score, peaks[2].score);
  for (std::size_t i = 0; i < 3; ++i) {
    for (std::size_t j = 0; j < i; ++j) {
      EXPECT_GE(std::hypot(peaks[i].x - peaks[j].x, peaks[i].y - peaks[j].y), 9.5);
    }
  }
  EXPECT_EQ(distinct_peaks(scores, 1, 10).size(), 1U);
  EXPECT_TRUE(distinct_peaks(cv::Mat(20, 20, CV_32FC1, cv::Scalar(-1)), 5, 3).empty());
}

}  // namespace
}  // namespace nadir
