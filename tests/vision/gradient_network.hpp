// A descriptor network that is none: histograms of gradients, modulo 180 degrees, around each cell. It finds places as
// a learned one does, needs no library, and is the same everywhere.
#pragma once

#include <cmath>
#include <numbers>
#include <opencv2/imgproc.hpp>

#include "vision/dense_descriptors.hpp"

namespace nadir::test {

class GradientNetwork final : public DenseDescriptorNetwork {
 public:
  int channels() const override { return kOrientations; }
  std::string name() const override { return "histograms of gradients"; }

  cv::Mat describe(const cv::Mat& grey) override {
    ++calls;
    largest_px = std::max(largest_px, static_cast<int>(grey.total()));
    cv::Mat smooth;
    cv::GaussianBlur(grey, smooth, {}, 1.0);
    const ImageGradient gradient = image_gradient(smooth);
    std::vector<cv::Mat> cells(kOrientations);
    for (int k = 0; k < kOrientations; ++k) {
      cv::Mat share(grey.size(), CV_32FC1);
      const double angle = std::numbers::pi * k / kOrientations;
      const auto cosine = static_cast<float>(std::cos(angle)), sine = static_cast<float>(std::sin(angle));
      for (int r = 0; r < grey.rows; ++r) {
        for (int c = 0; c < grey.cols; ++c) {
          const float along = gradient.x.at<float>(r, c) * cosine + gradient.y.at<float>(r, c) * sine;
          share.at<float>(r, c) = along * along + 0.01F;
        }
      }
      cv::GaussianBlur(share, share, {}, 4.0);
      cv::sqrt(share, share);
      cv::resize(share, cells[static_cast<std::size_t>(k)], grey.size() / kDescriptorCell_px, 0, 0, cv::INTER_AREA);
    }
    cv::Mat all;
    cv::merge(cells, all);
    return all;
  }

  int calls = 0, largest_px = 0;

 private:
  static constexpr int kOrientations = 8;
};

}  // namespace nadir::test
