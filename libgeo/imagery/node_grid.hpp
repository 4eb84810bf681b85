// Positions that are computed exactly at the nodes of a coarse grid and interpolated in between: for a remap of pixels
// from one projection to another a small fraction of a pixel off, and far quicker than every pixel by itself.
//
// positions_between_nodes() is for positions on maps and rasters, which are large numbers: nodes in double,
// interpolated in double along the rows of nodes, then straight float segments along each row of pixels once the caller
// has subtracted the origin of what it read. vision/rectification.hpp has fill_between_nodes() for positions within one
// frame: small numbers, every pixel bilinear in float. They round differently in the last bit, and packages and
// estimates are compared bit for bit; so there are two.
#pragma once

#include <algorithm>
#include <opencv2/core.hpp>

namespace nadir {

inline constexpr int kMapNodeStep_px = 32;

// How many nodes stand along so many pixels: the last one lies at the last pixel or beyond.
constexpr int map_nodes_along(int pixels) { return (pixels + kMapNodeStep_px - 1) / kMapNodeStep_px + 1; }

// The positions of a cell's pixels in one row: that of the first one, and what each adds.
struct NodeSegment {
  cv::Point2f start, step;
};

// CV_32FC2 of this size. node(row, column): the exact position, cv::Point2d, of pixel (column, row) times
// kMapNodeStep_px. segment(begin, end): the NodeSegment between positions that are kMapNodeStep_px pixels apart.
template <typename Node, typename Segment>
cv::Mat positions_between_nodes(const cv::Size& size, const Node& node, const Segment& segment) {
  constexpr int kStep = kMapNodeStep_px;
  const int cells = map_nodes_along(size.width) - 1;
  cv::Mat positions(size, CV_32FC2);
  for (int row = 0; row < size.height; ++row) {
    const int above = row / kStep;
    const double down = static_cast<double>(row % kStep) / kStep;
    auto* out = positions.ptr<cv::Point2f>(row);
    for (int cell = 0; cell < cells; ++cell) {
      const cv::Point2d begin = node(above, cell) * (1 - down) + node(above + 1, cell) * down;
      const cv::Point2d end = node(above, cell + 1) * (1 - down) + node(above + 1, cell + 1) * down;
      const NodeSegment line = segment(begin, end);
      const int columns = std::min(kStep, size.width - cell * kStep);
      for (int i = 0; i < columns; ++i) out[cell * kStep + i] = line.start + line.step * static_cast<float>(i);
    }
  }
  return positions;
}

}  // namespace nadir
