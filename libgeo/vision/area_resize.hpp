// Pictures made smaller: each pixel is the mean of the area that it covers, as by cv::resize(INTER_AREA), and with the
// same bits on every processor. OpenCV's machine code fuses products on arm64, and a pixel in hundreds is rounded the
// other way.
#pragma once

#include <opencv2/core.hpp>

namespace nadir {

// image: of 8 bits, with any number of channels. Sizes that divide the image's, and larger ones, are OpenCV's: it
// computes those in integers.
cv::Mat area_resized(const cv::Mat& image, cv::Size size);

}  // namespace nadir
