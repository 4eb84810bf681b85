#include "vision/sift_features.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <opencv2/core.hpp>
#include <opencv2/features2d.hpp>

#include "vision/synthetic_ground.hpp"

namespace nadir {
namespace {

constexpr SiftOptions kOptions{600, 3, 0.007};

cv::Mat picture() {
  const test::Landscape landscape(11, 150);
  CameraModel camera;
  camera.width = 360, camera.height = 270;
  camera.fx = camera.fy = 320;
  camera.cx = 179.5, camera.cy = 134.5;
  return test::photograph(landscape.ground(), camera, {{}, 110, {0.3, 0.02, -0.03}});
}

// Shares of the features of `first` that `second` has within so many pixels, with a descriptor that is alike.
double found_again(const SiftFeatures& first, const SiftFeatures& second, float within_px) {
  int found = 0;
  for (std::size_t i = 0; i < first.points.size(); ++i) {
    for (std::size_t j = 0; j < second.points.size(); ++j) {
      const cv::Point2f off = first.points[i] - second.points[j];
      if (std::hypot(off.x, off.y) > within_px) continue;
      double product = 0;
      for (std::size_t k = 0; k < FeatureDescriptors::kLength; ++k) {
        product += first.descriptors.at(i)[k] * second.descriptors.at(j)[k];
      }
      const double cosine = product / std::sqrt(static_cast<double>(first.descriptors.square(i)) *
                                                static_cast<double>(second.descriptors.square(j)));
      if (cosine > 0.97) {
        ++found;
        break;
      }
    }
  }
  return static_cast<double>(found) / static_cast<double>(first.points.size());
}

SiftFeatures opencv_features(const cv::Mat& image) {
  std::vector<cv::KeyPoint> points;
  cv::Mat descriptors;
  cv::SIFT::create(kOptions.max_features, kOptions.octave_layers, kOptions.min_contrast)
      ->detectAndCompute(image, cv::noArray(), points, descriptors);
  SiftFeatures features;
  // OpenCV does not count that pixels of the doubled image lie a quarter of a pixel beside those of the image.
  for (const cv::KeyPoint& point : points) features.points.push_back(point.pt - cv::Point2f(0.25F, 0.25F));
  features.descriptors = FeatureDescriptors(descriptors);
  return features;
}

TEST(SiftFeatures, AgreeWithOpencv) {
  const SiftFeatures own = sift_features(picture(), kOptions), opencv = opencv_features(picture());
  ASSERT_GT(opencv.points.size(), 300U);
  EXPECT_GT(found_again(own, opencv, 0.1F), 0.95);
  EXPECT_GT(found_again(opencv, own, 0.1F), 0.95);
}

TEST(SiftFeatures, AreFoundAgainInATurnedImageAsOftenAsOpencvs) {
  const cv::Mat image = picture();
  cv::Mat turned;
  cv::rotate(image, turned, cv::ROTATE_90_CLOCKWISE);
  const auto share = [&](const SiftFeatures& before, SiftFeatures after) {
    for (cv::Point2f& point : after.points) point = {point.y, static_cast<float>(image.rows - 1) - point.x};
    return found_again(before, after, 0.3F);
  };
  const double opencv = share(opencv_features(image), opencv_features(turned));
  EXPECT_GT(opencv, 0.7);
  EXPECT_GT(share(sift_features(image, kOptions), sift_features(turned, kOptions)), opencv - 0.02);
}

TEST(SiftFeatures, LieWhereASpotIs) {
  cv::Mat image(120, 160, CV_8UC1, cv::Scalar(90));
  const cv::Point2f spot(70.25F, 51.5F);
  for (int r = 0; r < image.rows; ++r) {
    for (int c = 0; c < image.cols; ++c) {
      const float dx = static_cast<float>(c) - spot.x, dy = static_cast<float>(r) - spot.y;
      image.at<std::uint8_t>(r, c) = cv::saturate_cast<std::uint8_t>(90 + 120 * std::exp(-(dx * dx + dy * dy) / 32));
    }
  }
  const SiftFeatures features = sift_features(image, kOptions);
  ASSERT_FALSE(features.points.empty());
  EXPECT_NEAR(features.points[0].x, spot.x, 0.05);
  EXPECT_NEAR(features.points[0].y, spot.y, 0.05);
}

TEST(SiftFeatures, TheStrongestAreKept) {
  const cv::Mat image = picture();
  const SiftFeatures all = sift_features(image, kOptions), few = sift_features(image, {50, 3, 0.007});
  ASSERT_GE(few.points.size(), 50U);
  ASSERT_LT(few.points.size(), 54U) << "as many more as the last one has directions";
  EXPECT_EQ(few.descriptors.size(), few.points.size());
  for (std::size_t i = 0; i < few.points.size(); ++i) EXPECT_EQ(few.points[i], all.points[i]);
}

TEST(SiftFeatures, NoneWhereThereIsNothing) {
  EXPECT_TRUE(sift_features(cv::Mat(200, 300, CV_8UC1, cv::Scalar(128)), kOptions).points.empty());
  for (const cv::Size size : {cv::Size(1, 1), cv::Size(7, 300), cv::Size(300, 7), cv::Size(8, 8), cv::Size(9, 11)}) {
    cv::Mat noise(size, CV_8UC1);
    cv::RNG(5).fill(noise, cv::RNG::UNIFORM, 0, 256);
    const SiftFeatures features = sift_features(noise, kOptions);
    for (const cv::Point2f& point : features.points) {
      EXPECT_TRUE(point.x >= 0 && point.x < static_cast<float>(size.width)) << size;
      EXPECT_TRUE(point.y >= 0 && point.y < static_cast<float>(size.height)) << size;
    }
  }
  EXPECT_TRUE(sift_features(cv::Mat(), kOptions).points.empty());
}

TEST(SiftFeatures, NoiseHasSoundDescriptors) {
  cv::Mat noise(150, 200, CV_8UC1);
  cv::RNG(6).fill(noise, cv::RNG::UNIFORM, 0, 256);
  const SiftFeatures features = sift_features(noise, kOptions);
  ASSERT_GT(features.points.size(), 100U);
  for (std::size_t i = 0; i < features.points.size(); ++i) {
    EXPECT_NEAR(std::sqrt(features.descriptors.square(i)), 512, 30);
    for (std::size_t k = 0; k < FeatureDescriptors::kLength; ++k) {
      ASSERT_TRUE(features.descriptors.at(i)[k] >= 0 && features.descriptors.at(i)[k] <= 255);
    }
  }
}

}  // namespace
}  // namespace nadir
