#include "raster/masked_image.hpp"

#include <array>
#include <cstdint>
#include <opencv2/imgproc.hpp>
#include <vector>

namespace nadir {
namespace {

// The average of the valid pixels of each 2 x 2 cell; valid when at least `min_valid` are.
MaskedImage averaged(const MaskedImage& image, unsigned min_valid) {
  MaskedImage half;
  half.bgr.create(image.bgr.rows / 2, image.bgr.cols / 2, CV_8UC3);
  half.mask.create(half.bgr.size(), CV_8UC1);
  for (int row = 0; row < half.bgr.rows; ++row) {
    const std::array<const cv::Vec3b*, 2> colours = {image.bgr.ptr<cv::Vec3b>(2 * row),
                                                     image.bgr.ptr<cv::Vec3b>(2 * row + 1)};
    const std::array<const std::uint8_t*, 2> valid = {image.mask.ptr<std::uint8_t>(2 * row),
                                                      image.mask.ptr<std::uint8_t>(2 * row + 1)};
    for (int column = 0; column < half.bgr.cols; ++column) {
      unsigned count = 0, blue = 0, green = 0, red = 0;
      for (std::size_t i = 0; i < 4; ++i) {
        const int at = 2 * column + static_cast<int>(i % 2);
        if (valid[i / 2][at] == 0) continue;
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
      half.mask.at<std::uint8_t>(row, column) = count >= min_valid ? 255 : 0;
    }
  }
  return half;
}

bool is_whole(const cv::Mat& mask) { return cv::countNonZero(mask) == mask.rows * mask.cols; }

}  // namespace

MaskedImage halved(const MaskedImage& image) {
  if (!is_whole(image.mask)) return averaged(image, 2);
  MaskedImage half;
  cv::resize(image.bgr, half.bgr, {}, 0.5, 0.5, cv::INTER_AREA);
  half.mask = cv::Mat(half.bgr.size(), CV_8UC1, cv::Scalar(255));
  return half;
}

void fill_invalid(MaskedImage& image) {
  if (is_whole(image.mask) || cv::countNonZero(image.mask) == 0) return;
  // Invalid pixels pad the sides to multiples of 256, so that every pyramid level has complete cells.
  constexpr int kMultiple = 256;
  const int right = (kMultiple - image.bgr.cols % kMultiple) % kMultiple;
  const int below = (kMultiple - image.bgr.rows % kMultiple) % kMultiple;
  if (right + below > 0) {
    MaskedImage padded;
    cv::copyMakeBorder(image.bgr, padded.bgr, 0, below, 0, right, cv::BORDER_CONSTANT, cv::Scalar::all(0));
    cv::copyMakeBorder(image.mask, padded.mask, 0, below, 0, right, cv::BORDER_CONSTANT, cv::Scalar::all(0));
    fill_invalid(padded);
    padded.bgr({0, 0, image.bgr.cols, image.bgr.rows}).copyTo(image.bgr);
    return;
  }
  std::vector<MaskedImage> levels = {{image.bgr, image.mask}};
  while (levels.back().bgr.rows % 2 == 0 && levels.back().bgr.cols % 2 == 0 && !is_whole(levels.back().mask)) {
    levels.push_back(averaged(levels.back(), 1));
  }
  if (!is_whole(levels.back().mask)) {  // blocks of 256 without a valid pixel: the mean colour of the image
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
