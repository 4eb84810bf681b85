#include "raster/masked_image.hpp"

#include <gtest/gtest.h>

#include <opencv2/imgproc.hpp>

namespace nadir {
namespace {

MaskedImage image(int side) {
  return {cv::Mat(side, side, CV_8UC3, cv::Scalar(10, 20, 30)), cv::Mat(side, side, CV_8UC1, cv::Scalar(255))};
}

TEST(MaskedImage, HalvesToAveragesOfValidPixels) {
  MaskedImage whole = image(4);
  whole.bgr.at<cv::Vec3b>(0, 0) = {50, 20, 30};
  whole.bgr.at<cv::Vec3b>(2, 2) = {255, 255, 255};
  EXPECT_EQ(halved(whole).bgr.at<cv::Vec3b>(0, 0), cv::Vec3b(20, 20, 30));

  whole.mask.at<std::uint8_t>(2, 2) = 0;  // the white one is not known: it must not count
  const MaskedImage half = halved(whole);
  EXPECT_EQ(half.bgr.at<cv::Vec3b>(1, 1), cv::Vec3b(10, 20, 30));
  EXPECT_EQ(cv::countNonZero(half.mask), 4);

  for (const cv::Point at : {cv::Point(3, 2), cv::Point(2, 3)}) whole.mask.at<std::uint8_t>(at) = 0;
  EXPECT_EQ(halved(whole).mask.at<std::uint8_t>(1, 1), 0);  // one of four
  EXPECT_EQ(cv::countNonZero(halved(whole).mask), 3);
}

TEST(MaskedImage, FillsWithoutAnEdge) {
  for (const int side : {256, 200}) {
    MaskedImage tile = image(side);
    for (int column = 0; column < side; ++column) tile.bgr.col(column).setTo(cv::Scalar(100, 150, 60 + column / 2));
    const cv::Rect hole(side / 2, 0, side / 2, side);
    tile.bgr(hole).setTo(cv::Scalar::all(0));
    tile.mask(hole).setTo(0);
    const cv::Mat known = tile.bgr(cv::Rect(0, 0, side / 2, side)).clone();
    fill_invalid(tile);
    EXPECT_EQ(cv::norm(tile.bgr(cv::Rect(0, 0, side / 2, side)), known, cv::NORM_INF), 0.0);
    double darkest = 0;
    cv::minMaxLoc(cv::Mat(tile.bgr.clone().reshape(1)), &darkest);
    EXPECT_GE(darkest, 60);
    for (int row = 0; row < side; ++row) {
      const cv::Vec3b left = tile.bgr.at<cv::Vec3b>(row, side / 2 - 1), right = tile.bgr.at<cv::Vec3b>(row, side / 2);
      EXPECT_LE(cv::norm(left, right, cv::NORM_INF), 30.0);
    }
  }
}

TEST(MaskedImage, WithoutValidPixelsNothingChanges) {
  MaskedImage tile = image(256);
  tile.mask.setTo(0);
  fill_invalid(tile);
  EXPECT_EQ(tile.bgr.at<cv::Vec3b>(7, 7), cv::Vec3b(10, 20, 30));
}

}  // namespace
}  // namespace nadir
