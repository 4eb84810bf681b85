// A picture's coordinates that were computed exactly at the nodes of a coarse grid, filled in between: bilinear, which
// for perspective and lens is a small fraction of a pixel off and ten times as fast.
#pragma once

#include <opencv2/core/mat.hpp>

namespace nadir {

// How many nodes stand along so many pixels: the last one lies at the last pixel or beyond.
constexpr int nodes_along(int pixels, int step) { return (pixels + step - 1) / step + 1; }

// nodes: CV_32FC2, node (c, r) being that of pixel (c · step, r · step). The result, CV_32FC2 of the given size, is
// written to `pixels`, which may be a part of a larger picture.
inline void fill_between_nodes(const cv::Mat& nodes, int step, cv::Mat& pixels) {
  for (int r = 0; r < pixels.rows; ++r) {
    const int node_row = r / step;
    const float v = static_cast<float>(r % step) / static_cast<float>(step);
    const auto* above = nodes.ptr<cv::Vec2f>(node_row);
    const auto* below = nodes.ptr<cv::Vec2f>(node_row + 1);
    auto* row = pixels.ptr<cv::Vec2f>(r);
    for (int c = 0; c < pixels.cols; ++c) {
      const int n = c / step;
      const float u = static_cast<float>(c % step) / static_cast<float>(step);
      row[c] = (1 - v) * ((1 - u) * above[n] + u * above[n + 1]) + v * ((1 - u) * below[n] + u * below[n + 1]);
    }
  }
}

}  // namespace nadir
