#include "ortho/image_blur.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <opencv2/imgproc.hpp>
#include <vector>

#include "base/quantile.hpp"

namespace nadir {
namespace {

constexpr double kFirst_px = 1, kSecond_px = 2;  // the two blurs of our own
constexpr float kMinGradient = 3;            // grey levels a pixel: five times what noise of 3 levels leaves of itself
constexpr std::size_t kMinEdges = 60;        // in a direction
constexpr int kBlock_px = 160, kBlocks = 3;  // sampled blocks per side: constant cost for any image
constexpr int kDirections = 4;               // across: east, north-east, north, north-west

struct Gradient {
  cv::Mat_<float> east, south, length;
};

Gradient gradient_of(const cv::Mat& grey, double blur_px) {
  cv::Mat blurred;
  grey.convertTo(blurred, CV_32F);
  cv::GaussianBlur(blurred, blurred, {}, blur_px);
  Gradient gradient;
  cv::Sobel(blurred, gradient.east, CV_32F, 1, 0, 1, 0.5);
  cv::Sobel(blurred, gradient.south, CV_32F, 0, 1, 1, 0.5);
  cv::magnitude(gradient.east, gradient.south, gradient.length);
  return gradient;
}

int direction_of(float east, float south) {
  const double turn = std::atan2(double{south}, double{east}) / CV_PI * kDirections;  // of half a circle
  return (static_cast<int>(std::lround(turn)) + 2 * kDirections) % kDirections;
}

using GradientRatios = std::array<std::vector<float>, kDirections>;

// Ratios of the gradients of edges after the two blurs, by direction.
void add_gradient_ratios(const cv::Mat& grey, GradientRatios& ratios) {
  static const std::array<cv::Point, kDirections> kAcross{{{1, 0}, {1, 1}, {0, 1}, {-1, 1}}};
  const Gradient first = gradient_of(grey, kFirst_px), second = gradient_of(grey, kSecond_px);
  for (int row = 1; row + 1 < grey.rows; ++row) {
    for (int column = 1; column + 1 < grey.cols; ++column) {
      const float here = first.length(row, column);
      if (here < kMinGradient) continue;
      const auto direction = static_cast<std::size_t>(direction_of(first.east(row, column), first.south(row, column)));
      const cv::Point across = kAcross.at(direction);
      const bool crest = here >= first.length(row + across.y, column + across.x) &&
                         here > first.length(row - across.y, column - across.x);
      if (crest) ratios.at(direction).push_back(here / second.length(row, column));
    }
  }
}

// Where the blocks begin along one side of the image, evenly from end to end.
std::vector<int> starts(int size) {
  const int blocks = std::clamp(size / kBlock_px, 1, kBlocks);
  std::vector<int> all;
  for (int i = 0; i < blocks; ++i) all.push_back(blocks == 1 ? 0 : (size - kBlock_px) * i / (blocks - 1));
  return all;
}

// Solves the equation of image_blur.hpp for s; factor = g(b1) / g(b2).
double blur_from(double factor) {
  constexpr double kDifference2 = 1.0 / 3;  // what differences over two pixels blur themselves
  constexpr double kFirst2 = kFirst_px * kFirst_px, kSecond2 = kSecond_px * kSecond_px;
  const double squared = std::clamp(factor * factor, 1.001, kSecond2 / kFirst2);
  const double blur2 = (kSecond2 - squared * kFirst2) / (squared - 1);
  return std::sqrt(std::max(0.0, blur2 - kDifference2));
}

}  // namespace

std::optional<double> blur_of(const cv::Mat& grey) {
  if (grey.empty()) return std::nullopt;
  GradientRatios all;
  for (const int y : starts(grey.rows)) {
    for (const int x : starts(grey.cols)) {
      const cv::Rect block(x, y, grey.cols < 2 * kBlock_px ? grey.cols : kBlock_px,
                           grey.rows < 2 * kBlock_px ? grey.rows : kBlock_px);
      add_gradient_ratios(grey(block), all);
    }
  }
  std::optional<double> worst;
  for (std::vector<float>& ratios : all) {
    if (ratios.size() < kMinEdges) continue;
    worst = std::max(worst.value_or(0), blur_from(median(std::move(ratios))));
  }
  return worst;
}

}  // namespace nadir
