// Descriptors of features: SIFT's histograms of gradient orientations (Lowe 2004, 4 x 4 cells of 8 orientations), read
// from a small pyramid at 16 x 16 positions around each feature. OpenCV's visits every pixel of the doubled image, some
// 1200 to 4800 around a feature, and costs six times as much.
#pragma once

#include <opencv2/core/mat.hpp>
#include <opencv2/core/types.hpp>
#include <vector>

namespace nadir {

// grey: CV_8UC1. features: as cv::SIFT detects them in `grey`: position, size (twice the scale's σ) and angle. The
// result: CV_32FC1, one row of 128 whole numbers from 0 to 255 for each.
cv::Mat describe_features(const cv::Mat& grey, const std::vector<cv::KeyPoint>& features);

}  // namespace nadir
