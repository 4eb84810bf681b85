#include "simulation/lighting.hpp"

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>

namespace nadir {
namespace {

constexpr double kTallest_m = 32;

// Height of the shadow's upper limit over every pixel: swept away from the sun, each step lower by the sun's slope.
cv::Mat_<float> shadow_tops(const cv::Mat_<float>& heights, double gsd_m, const Sun& sun) {
  // Light travels this way over the picture (x right, y down).
  const double dx = -std::sin(sun.azimuth_rad), dy = std::cos(sun.azimuth_rad);
  const bool transpose = std::abs(dx) > std::abs(dy);
  cv::Mat_<float> h = transpose ? cv::Mat_<float>(heights.t()) : heights.clone();
  const double major = transpose ? dx : dy, minor = transpose ? dy : dx;
  const double shift = minor / std::abs(major);  // sideways per row
  const auto drop = static_cast<float>(gsd_m * std::tan(sun.elevation_rad) * std::hypot(1.0, shift));
  const int step = major > 0 ? 1 : -1, first = major > 0 ? 0 : h.rows - 1;
  const int whole = static_cast<int>(std::floor(-shift));
  const auto part = static_cast<float>(-shift - whole);
  for (int n = 1, row = first + step; n < h.rows; ++n, row += step) {
    const float* from = h[row - step];
    float* to = h[row];
    for (int c = 0; c < h.cols; ++c) {
      const int a = std::clamp(c + whole, 0, h.cols - 1), b = std::clamp(c + whole + 1, 0, h.cols - 1);
      to[c] = std::max(to[c], from[a] + part * (from[b] - from[a]) - drop);
    }
  }
  return transpose ? cv::Mat_<float>(h.t()) : h;
}

// Slope of the relief to the east and to the north, from a coarse grid: the relief is smooth.
cv::Mat_<cv::Vec2f> relief_slopes(const PixelGrid& grid, const Relief& relief) {
  constexpr int step = 8;
  constexpr double reach = 12;
  cv::Mat_<cv::Vec2f> nodes(grid.rows / step + 2, grid.columns / step + 2), slopes;
  for (int r = 0; r < nodes.rows; ++r) {
    for (int c = 0; c < nodes.cols; ++c) {
      const double x = grid.x(c * step), y = grid.y(r * step);
      nodes(r, c) = {static_cast<float>((relief.at({x + reach, y}) - relief.at({x - reach, y})) / (2 * reach)),
                     static_cast<float>((relief.at({x, y + reach}) - relief.at({x, y - reach})) / (2 * reach))};
    }
  }
  cv::resize(nodes, slopes, cv::Size(), step, step, cv::INTER_LINEAR);
  return slopes;  // a little larger than the grid; off by less than half a node, which no eye sees
}

float min_mod(float a, float b) {
  if (a * b <= 0) return 0;
  return std::abs(a) < std::abs(b) ? a : b;
}

}  // namespace

double shadow_reach_m(const Sun& sun) { return kTallest_m / std::tan(sun.elevation_rad); }

void light_painting(Painting& painting, const PixelGrid& grid, const Relief& relief, const Sun& sun) {
  const cv::Mat_<float>& h = painting.height_m;
  const cv::Mat_<float> tops = shadow_tops(h, grid.gsd_m, sun);
  cv::Mat_<float> around;
  const int window = std::max(3, static_cast<int>(std::lround(9 / grid.gsd_m)) | 1);
  cv::blur(h, around, cv::Size(window, window));
  const cv::Mat_<cv::Vec2f> slopes = relief_slopes(grid, relief);
  const double se = std::sin(sun.elevation_rad), ce = std::cos(sun.elevation_rad);
  const double sx = std::sin(sun.azimuth_rad) * ce, sy = std::cos(sun.azimuth_rad) * ce;
  const cv::Vec3d sky(1.30, 1.02, 0.82), warm(0.96, 1.0, 1.02);
  for (int row = 0; row < grid.rows; ++row) {
    const int up = std::max(0, row - 1), down = std::min(grid.rows - 1, row + 1);
    for (int column = 0; column < grid.columns; ++column) {
      const int left = std::max(0, column - 1), right = std::min(grid.columns - 1, column + 1);
      const float here = h(row, column);
      // The smaller of the two one-sided slopes: roofs and crowns keep theirs, walls have none.
      const double gx =
          std::clamp(static_cast<double>(min_mod(here - h(row, left), h(row, right) - here)) / grid.gsd_m, -1.3, 1.3);
      const double gy = std::clamp(
          static_cast<double>(min_mod(here - h(down, column), h(up, column) - here)) / grid.gsd_m, -1.3, 1.3);
      const double wet = static_cast<double>(painting.gloss(row, column));
      const cv::Vec2f slope = slopes(row, column) * static_cast<float>(1 - wet);
      const double tx = static_cast<double>(slope[0]), ty = static_cast<double>(slope[1]);
      const double nx = -(gx + 1.3 * tx), ny = -(gy + 1.3 * ty);
      const double facing = std::max(0.0, (nx * sx + ny * sy + se) / std::sqrt(1 + nx * nx + ny * ny)) / se;
      const double depth = static_cast<double>(tops(row, column) - here);
      const double lit = 1 - std::clamp((depth - 0.15) / 0.7, 0.0, 1.0);
      const double hollow = std::clamp(static_cast<double>(around(row, column) - here) * 0.045, 0.0, 0.45);
      const double direct = 0.74 * lit * std::min(facing, 1.5), ambient = 0.26 * (1 - hollow);
      cv::Vec3f& pixel = painting.colour(row, column);
      for (int i = 0; i < 3; ++i) pixel[i] *= static_cast<float>(direct * warm[i] + ambient * sky[i]);
    }
  }
}

}  // namespace nadir
