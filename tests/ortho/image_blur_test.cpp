#include "ortho/image_blur.hpp"

#include <gtest/gtest.h>

#include <map>
#include <opencv2/imgproc.hpp>

#include "base/random.hpp"
#include "ortho/eligibility.hpp"
#include "vision/synthetic_ground.hpp"

namespace nadir {
namespace {

// What a camera sees of parcels, hedges, roads and roofs, 0.26 m a pixel.
const cv::Mat& sharp(std::uint64_t seed = 8) {
  static std::map<std::uint64_t, cv::Mat> made;
  cv::Mat& picture = made[seed];
  if (picture.empty()) {
    const test::Landscape land(seed, 130, 0.2);
    picture = test::photograph(land.ground(), test::small_camera().scaled(2), {{0, 0}, 100, {0.3, 0.02, -0.01}}, 2);
  }
  return picture;
}

cv::Mat noisy(const cv::Mat& picture, double sigma, std::uint64_t seed = 1) {
  cv::Mat result = picture.clone();
  Random random(seed);
  for (int r = 0; r < result.rows; ++r) {
    for (int c = 0; c < result.cols; ++c) {
      auto& pixel = result.at<std::uint8_t>(r, c);
      pixel = cv::saturate_cast<std::uint8_t>(pixel + random.normal(0, sigma));
    }
  }
  return result;
}

cv::Mat defocused(const cv::Mat& picture, double radius_px) {  // a disc, as a lens makes it
  const int half = static_cast<int>(std::ceil(radius_px));
  cv::Mat disc(2 * half + 1, 2 * half + 1, CV_32F);
  for (int r = -half; r <= half; ++r) {
    for (int c = -half; c <= half; ++c) disc.at<float>(r + half, c + half) = std::hypot(r, c) <= radius_px ? 1.F : 0.F;
  }
  cv::Mat result;
  cv::filter2D(picture, result, -1, disc / cv::sum(disc)[0]);
  return result;
}

cv::Mat moved(const cv::Mat& picture, int streak_px, bool slanting) {
  cv::Mat streak = cv::Mat::zeros(streak_px, streak_px, CV_32F);
  for (int i = 0; i < streak_px; ++i)
    streak.at<float>(slanting ? i : streak_px / 2, i) = 1.F / static_cast<float>(streak_px);
  cv::Mat result;
  cv::filter2D(picture, result, -1, streak);
  return result;
}

cv::Mat with_contrast(const cv::Mat& picture, double factor, double level) {
  cv::Mat result;
  picture.convertTo(result, CV_8U, factor, level - factor * cv::mean(picture)[0]);
  return result;
}

bool refused(const cv::Mat& picture) { return check_blur_eligible(blur_of(picture), 1.2, {}).has_value(); }

TEST(ImageBlur, MeasuresAnUnknownGaussian) {
  // Edges far from each other, whose blur is known exactly.
  cv::Mat bars(400, 400, CV_8UC1, cv::Scalar(60));
  for (int from = 40; from < bars.cols; from += 80) bars.colRange(from, from + 40) = 190;
  for (const double sigma : {1.0, 1.5, 2.0, 3.0, 4.0}) {
    cv::Mat soft;
    cv::GaussianBlur(bars, soft, {}, sigma);
    const auto blur = blur_of(soft);
    ASSERT_TRUE(blur) << sigma;
    EXPECT_NEAR(*blur, sigma, 0.12 * sigma) << sigma;
  }
}

TEST(ImageBlur, GrowsWithDefocusAndMotion) {
  const cv::Mat& picture = sharp();
  double before = blur_of(picture).value();
  for (const double radius : {2.0, 4.0, 6.0, 8.0}) {
    const double blur = blur_of(defocused(picture, radius)).value();
    EXPECT_GT(blur, before) << radius;
    before = blur;
  }
  for (const bool slanting : {false, true}) {
    before = blur_of(picture).value();
    for (const int streak : {5, 9, 13, 17}) {
      const double blur = blur_of(moved(picture, streak, slanting)).value();
      EXPECT_GT(blur, before) << streak;
      before = blur;
    }
  }
}

TEST(ImageBlur, RejectsFivePixelsOfDefocusAndAcceptsOne) {
  for (const std::uint64_t seed : {8U, 9U, 10U}) {
    const cv::Mat& picture = sharp(seed);
    for (const double sigma : {0.0, 2.0}) {
      EXPECT_FALSE(refused(noisy(picture, sigma))) << seed;
      EXPECT_FALSE(refused(noisy(defocused(picture, 1), sigma))) << seed;
      for (const double radius : {5.0, 7.0, 9.0})
        EXPECT_TRUE(refused(noisy(defocused(picture, radius), sigma))) << radius;
    }
  }
}

TEST(ImageBlur, RejectsElevenPixelsOfMotionBlurAndAcceptsThree) {
  for (const std::uint64_t seed : {8U, 9U, 10U}) {
    const cv::Mat& picture = sharp(seed);
    for (const double sigma : {0.0, 2.0}) {
      for (const bool slanting : {false, true}) {
        EXPECT_FALSE(refused(noisy(moved(picture, 3, slanting), sigma))) << seed;
        for (const int streak : {11, 15, 21})
          EXPECT_TRUE(refused(noisy(moved(picture, streak, slanting), sigma))) << streak;
      }
    }
  }
}

TEST(ImageBlur, FieldsAndSnowAreNotBlurred) {
  for (const std::uint64_t seed : {8U, 9U, 10U}) {
    for (const double sigma : {0.0, 2.0, 5.0}) {
      EXPECT_FALSE(refused(noisy(with_contrast(sharp(seed), 0.3, 120), sigma))) << "fields in haze";
      EXPECT_FALSE(refused(noisy(with_contrast(sharp(seed), 0.08, 215), sigma))) << "snow";
      EXPECT_FALSE(refused(noisy(cv::Mat(480, 640, CV_8UC1, cv::Scalar(225)), sigma))) << "nothing but snow";
    }
  }
}

TEST(ImageBlur, IsUnknownWithoutEdges) {
  EXPECT_FALSE(blur_of(cv::Mat(480, 640, CV_8UC1, cv::Scalar(128))));
  EXPECT_FALSE(blur_of(cv::Mat()));
  EXPECT_FALSE(blur_of(cv::Mat(1, 1, CV_8UC1, cv::Scalar(7))));
  EXPECT_FALSE(blur_of(cv::Mat(2, 700, CV_8UC1, cv::Scalar(7))));
}

TEST(ImageBlur, IsCheckedInTileSizedPixels) {
  EXPECT_FALSE(check_blur_eligible(std::nullopt, 1, {}));
  EXPECT_FALSE(check_blur_eligible(1.8, 1, {}));
  EXPECT_EQ(check_blur_eligible(1.81, 1, {}), OrthoRefusal::blurred);
  EXPECT_FALSE(check_blur_eligible(2.9, 2, {})) << "a tile's pixel is two of the picture's";
  EXPECT_EQ(check_blur_eligible(3.1, 2, {}), OrthoRefusal::blurred);
  EXPECT_EQ(check_blur_eligible(std::nan(""), 1, {}), OrthoRefusal::blurred);
}

}  // namespace
}  // namespace nadir
