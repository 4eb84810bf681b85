#include "vision/area_resize.hpp"

#include <gtest/gtest.h>

#include <opencv2/imgproc.hpp>

#include "base/random.hpp"

namespace nadir {
namespace {

cv::Mat speckles(int columns, int rows) {
  Random random(5);
  cv::Mat image(rows, columns, CV_8UC1);
  for (int r = 0; r < rows; ++r) {
    for (int c = 0; c < columns; ++c) image.at<std::uint8_t>(r, c) = static_cast<std::uint8_t>(random.integer(0, 255));
  }
  return image;
}

// OpenCV's own rounds a pixel in hundreds the other way where its machine code fuses products.
TEST(AreaResize, IsOpenCvs) {
  const cv::Mat image = speckles(640, 361);
  for (const cv::Size size :
       {cv::Size{499, 281}, {320, 180}, {101, 361}, {639, 360}, {640, 361}, {160, 91}, {1, 1}, {900, 500}}) {
    cv::Mat expected;
    cv::resize(image, expected, size, 0, 0, cv::INTER_AREA);
    const cv::Mat found = area_resized(image, size);
    ASSERT_EQ(found.size(), size);
    EXPECT_LE(cv::norm(found, expected, cv::NORM_INF), 1) << size;
    EXPECT_LE(cv::countNonZero(found != expected), 0.01 * size.area()) << size;
  }
}

TEST(AreaResize, KeepsWhatIsEvenAndTheMean) {
  const cv::Mat even(97, 131, CV_8UC1, cv::Scalar(200));
  EXPECT_EQ(cv::countNonZero(area_resized(even, {50, 31}) != 200), 0);
  const cv::Mat image = speckles(300, 200);
  EXPECT_NEAR(cv::mean(area_resized(image, {77, 51}))[0], cv::mean(image)[0], 0.2);
}

// Of one pixel and a half: 10, and half of 40.
TEST(AreaResize, WeighsByTheAreaThatIsCovered) {
  const cv::Mat row = (cv::Mat_<std::uint8_t>(1, 3) << 10, 40, 100);
  const cv::Mat found = area_resized(row, {2, 1});
  EXPECT_EQ(found.at<std::uint8_t>(0, 0), 20);
  EXPECT_EQ(found.at<std::uint8_t>(0, 1), 80);
}

TEST(AreaResize, TakesEachColourByItself) {
  const cv::Mat image = speckles(300, 200);
  cv::Mat colour;
  cv::merge(std::vector<cv::Mat>{image, 255 - image, image}, colour);
  std::vector<cv::Mat> parts;
  cv::split(area_resized(colour, {77, 51}), parts);
  EXPECT_EQ(cv::countNonZero(parts[0] != area_resized(image, {77, 51})), 0);
  EXPECT_EQ(cv::countNonZero(parts[1] != area_resized(255 - image, {77, 51})), 0);
}

TEST(AreaResize, RefusesOtherPictures) { EXPECT_ANY_THROW(area_resized(cv::Mat(8, 8, CV_32FC1), {3, 3})); }

}  // namespace
}  // namespace nadir
