#include "raster/picture.hpp"

#include <array>
#include <cstdint>
#include <opencv2/imgproc.hpp>
#include <vector>

namespace nadir {
namespace {

// The average of the known pixels of each 2 x 2 cell; known when at least `enough` are.
Picture averaged(const Picture& picture, unsigned enough) {
  Picture half;
  half.bgr.create(picture.bgr.rows / 2, picture.bgr.cols / 2, CV_8UC3);
  half.mask.create(half.bgr.size(), CV_8UC1);
  for (int row = 0; row < half.bgr.rows; ++row) {
    const std::array<const cv::Vec3b*, 2> colours = {picture.bgr.ptr<cv::Vec3b>(2 * row),
                                                     picture.bgr.ptr<cv::Vec3b>(2 * row + 1)};
    const std::array<const std::uint8_t*, 2> known = {picture.mask.ptr<std::uint8_t>(2 * row),
                                                      picture.mask.ptr<std::uint8_t>(2 * row + 1)};
    for (int column = 0; column < half.bgr.cols; ++column) {
      unsigned count = 0, blue = 0, green = 0, red = 0;
      for (std::size_t i = 0; i < 4; ++i) {
        const int at = 2 * column + static_cast<int>(i % 2);
        if (known[i / 2][at] == 0) continue;
        const cv::Vec3b& colour = colours[i / 2][at];
        blue += colour[0], green += colour[1], red += colour[2], ++count;
      }
      cv::Vec3b& out = half.bgr.at<cv::Vec3b>(row, column);
      if (count > 0) {
        const unsigned round = count / 2;
        out = {static_cast<std::uint8_t>((blue + round) / count), static_cast<std::uint8_t>((green + round) / count),
               static_cast<std::uint8_t>((red + round) / count)};
      } else {
        out = {0, 0, 0};
      }
      half.mask.at<std::uint8_t>(row, column) = count >= enough ? 255 : 0;
    }
  }
  return half;
}

bool is_whole(const cv::Mat& mask) { return cv::countNonZero(mask) == mask.rows * mask.cols; }

}  // namespace

Picture halved(const Picture& picture) {
  if (!is_whole(picture.mask)) return averaged(picture, 2);
  Picture half;
  cv::resize(picture.bgr, half.bgr, {}, 0.5, 0.5, cv::INTER_AREA);
  half.mask = cv::Mat(half.bgr.size(), CV_8UC1, cv::Scalar(255));
  return half;
}

void fill_unknown(Picture& picture) {
  if (is_whole(picture.mask) || cv::countNonZero(picture.mask) == 0) return;
  // Sides are made multiples of 256 with more unknown pixels, so that cells stay whole on the way up.
  constexpr int kMultiple = 256;
  const int right = (kMultiple - picture.bgr.cols % kMultiple) % kMultiple;
  const int below = (kMultiple - picture.bgr.rows % kMultiple) % kMultiple;
  if (right + below > 0) {
    Picture padded;
    cv::copyMakeBorder(picture.bgr, padded.bgr, 0, below, 0, right, cv::BORDER_CONSTANT, cv::Scalar::all(0));
    cv::copyMakeBorder(picture.mask, padded.mask, 0, below, 0, right, cv::BORDER_CONSTANT, cv::Scalar::all(0));
    fill_unknown(padded);
    padded.bgr({0, 0, picture.bgr.cols, picture.bgr.rows}).copyTo(picture.bgr);
    return;
  }
  std::vector<Picture> levels = {{picture.bgr, picture.mask}};
  while (levels.back().bgr.rows % 2 == 0 && levels.back().bgr.cols % 2 == 0 && !is_whole(levels.back().mask)) {
    levels.push_back(averaged(levels.back(), 1));
  }
  if (!is_whole(levels.back().mask)) {  // whole 256ths without a known pixel: the mean colour of all
    const cv::Scalar mean = cv::mean(levels.back().bgr, levels.back().mask);
    levels.back().bgr.setTo(mean, levels.back().mask == 0);
  }
  for (std::size_t i = levels.size() - 1; i > 0; --i) {
    cv::Mat smooth;
    cv::resize(levels[i].bgr, smooth, levels[i - 1].bgr.size(), 0, 0, cv::INTER_LINEAR);
    smooth.copyTo(levels[i - 1].bgr, levels[i - 1].mask == 0);
  }
}

}  // namespace nadir
