#include "vision/correlation.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <opencv2/core.hpp>
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

// A disc or a wedge of the image is invalid, as with frames that are tilted and maps that end.
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

// A large window is transformed in parts, and two templates are transformed back at once: the same scores.
TEST(Correlation, PartsAndPairsScoreTheSame) {
  Random random(21);
  Channels window = random_channels(random, 700, 610, 1);
  punch(window, {300, 200, 80, 90});
  Channels pattern = random_channels(random, 33, 21, 1), other = random_channels(random, 33, 21, 1);
  punch(pattern, {0, 0, 9, 5});
  other.mask = pattern.mask;
  const WindowSpectra whole(window), parts(window, pattern.mask.size());
  const TemplateNorm of_whole(pattern, whole), of_parts(pattern, parts);
  const cv::Mat expected = correlate(pattern, whole, of_whole), expected_other = correlate(other, whole, of_whole);
  EXPECT_LT(cv::norm(correlate(pattern, parts, of_parts), expected, cv::NORM_INF), 1e-5);
  const std::vector<cv::Mat> both = TemplateSpectra(pattern, &other, parts).scores(parts, of_parts);
  EXPECT_LT(cv::norm(both[0], expected, cv::NORM_INF), 1e-5);
  EXPECT_LT(cv::norm(both[1], expected_other, cv::NORM_INF), 1e-5);
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

TEST(Correlation, AWindowWithoutTextureScoresNothing) {
  Random random(15);
  Channels flat = random_channels(random, 40, 40, 1);
  flat.pairs[0].setTo(cv::Scalar::all(0.3));
  const Channels pattern = random_channels(random, 20, 20, 1);
  const WindowSpectra spectra(flat);
  const cv::Mat scores = correlate(pattern, spectra, TemplateNorm(pattern, spectra));
  EXPECT_EQ(cv::countNonZero(scores == -1.0F), static_cast<int>(scores.total()));
  EXPECT_TRUE(distinct_peaks(scores, 5, 3).empty());
}

TEST(Correlation, FindsACutOutPatch) {
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

TEST(Peaks, InterpolatesBetweenPixels) {
  for (const auto& [x, y] : {std::pair{20.3, 14.8}, std::pair{7.5, 22.1}, std::pair{31.0, 9.49}}) {
    const Peak peak = best_peak(hills({{x, y, 0.9}}, {40, 30}));
    EXPECT_NEAR(peak.x, x, 0.03);
    EXPECT_NEAR(peak.y, y, 0.03);
    EXPECT_NEAR(peak.curvature_x, 0.9 / 9, 0.01) << "−d²/dx² of the hill's top";
    EXPECT_NEAR(peak.curvature_y, 0.9 / 9, 0.01);
  }
}

TEST(Peaks, StaysInsideAtTheBorder) {
  const Peak peak = best_peak(hills({{-3, 29, 0.9}}, {40, 30}));
  EXPECT_EQ(peak.x, 0);
  EXPECT_EQ(peak.y, 29);
}

TEST(Peaks, DistinctPeaksBestFirst) {
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

class DirectCorrelation : public testing::Test {
 protected:
  DirectCorrelation() {
    cv::Mat mask(90, 110, CV_8UC1, cv::Scalar(255));
    cv::line(mask, {0, 30}, {109, 70}, cv::Scalar(0), 5);  // rows of two runs
    mask.rowRange(0, 6).setTo(0);
    picture = oriented_channels(noise({110, 90}, 1), mask, ChannelSet::six_orientations);
    map = oriented_channels(noise({110, 90}, 1) * 0.6 + noise({110, 90}, 2) * 0.4, {}, ChannelSet::six_orientations);
  }

  Channels picture, map;
};

TEST_F(DirectCorrelation, EqualsTheFormula) {
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

TEST_F(DirectCorrelation, AgreesWithTransforms) {
  const QuantizedChannels whole_picture(picture), whole_map(map);
  const cv::Rect part(30, 20, 40, 44), wide(25, 14, 52, 56);
  const Channels pattern = cut(picture, part);
  const WindowSpectra window(cut(map, wide));
  const cv::Mat expected = correlate(pattern, window, TemplateNorm(pattern, window));
  const cv::Mat scores = LocalTemplate(whole_picture, part).scores(whole_map, wide.tl(), expected.size());
  EXPECT_LT(cv::norm(scores, expected, cv::NORM_INF), 0.01);
}

TEST_F(DirectCorrelation, StepsAreASubsetOfAllPlacements) {
  const QuantizedChannels whole_picture(picture), whole_map(map);
  const LocalTemplate pattern(whole_picture, {20, 10, 48, 40});
  const cv::Mat all = pattern.scores(whole_map, {12, 6}, {11, 9}),
                some = pattern.scores(whole_map, {12, 6}, {4, 3}, 0.6, 3);
  for (int v = 0; v < 3; ++v) {
    for (int u = 0; u < 4; ++u) EXPECT_EQ(some.at<float>(v, u), all.at<float>(3 * v, 3 * u));
  }
}

// What lies off the map counts as its mean, as in correlation.cpp.
TEST_F(DirectCorrelation, AgreesWithTransformsBesideGapsOfTheMap) {
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

TEST_F(DirectCorrelation, TexturelessGroundMatchesNothing) {
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

// Channels of the map that serve more than one comparison: the same scores as channels made for each.
constexpr ChannelSet kSet = ChannelSet::six_orientations;

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

TEST_F(MapChannelsTest, ALargerRegionScoresTheSame) {
  MapChannels narrow(image, mask, kSet, {}), wide(image, mask, kSet, {});
  narrow.cover({97, 77, 66, 56});
  wide.cover({20, 20, 200, 160});
  const cv::Mat one = scores(narrow), other = scores(wide);
  EXPECT_LT(cv::norm(one, other, cv::NORM_INF), 0.03);  // the levelling sees another neighbourhood
  cv::Point best;
  cv::minMaxLoc(other, nullptr, nullptr, nullptr, &best);
  EXPECT_EQ(best, cv::Point(3, 3));
}

TEST_F(MapChannelsTest, AreRecomputedOnlyWhenNeeded) {
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

TEST_F(MapChannelsTest, NothingIsValidBeyondTheMap) {
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
