#include "package/tile_fill.hpp"

#include <array>
#include <opencv2/core.hpp>
#include <vector>

#include "geodesy/web_mercator.hpp"

namespace nadir {
namespace {

constexpr int kBlock = 16;  // pixels
constexpr int kBlocks = kTileSize / kBlock;
constexpr double kNear = 3;  // JPEG does not give black and white back exactly

enum class Kind : std::uint8_t { ground, black, white };

Kind kind_of(const cv::Mat& block) {
  double low = 0, high = 0;
  cv::minMaxLoc(block.clone().reshape(1), &low, &high);
  if (high <= kNear) return Kind::black;
  return low >= 255 - kNear ? Kind::white : Kind::ground;
}

}  // namespace

cv::Mat edge_fill(const cv::Mat& image) {
  std::array<Kind, kBlocks * kBlocks> kinds{};
  std::array<bool, kBlocks * kBlocks> taken{};
  std::vector<int> open;
  const auto take = [&](int index) {
    const auto at = static_cast<std::size_t>(index);
    if (taken[at] || kinds[at] == Kind::ground) return;
    taken[at] = true;
    open.push_back(index);
  };
  for (int index = 0; index < kBlocks * kBlocks; ++index) {
    const cv::Rect place(index % kBlocks * kBlock, index / kBlocks * kBlock, kBlock, kBlock);
    kinds[static_cast<std::size_t>(index)] = kind_of(image(place));
  }
  for (int i = 0; i < kBlocks; ++i) {
    for (const int edge : {i, (kBlocks - 1) * kBlocks + i, i * kBlocks, i * kBlocks + kBlocks - 1}) take(edge);
  }
  cv::Mat fill(kTileSize, kTileSize, CV_8UC1, cv::Scalar(0));
  int count = 0;
  while (!open.empty()) {
    const int index = open.back();
    open.pop_back();
    ++count;
    const int column = index % kBlocks, row = index / kBlocks;
    fill(cv::Rect(column * kBlock, row * kBlock, kBlock, kBlock)).setTo(255);
    if (column > 0) take(index - 1);
    if (column + 1 < kBlocks) take(index + 1);
    if (row > 0) take(index - kBlocks);
    if (row + 1 < kBlocks) take(index + kBlocks);
  }
  return count >= kLeastFillBlocks ? fill : cv::Mat();
}

}  // namespace nadir
