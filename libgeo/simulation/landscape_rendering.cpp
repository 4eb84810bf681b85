#include "simulation/landscape_rendering.hpp"

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>

#include "geodesy/angles.hpp"
#include "geodesy/hypotenuse.hpp"

namespace nadir {
namespace {

constexpr double kTallest_m = 32;

// Height of the shadow's upper limit over every pixel: swept away from the sun, falling with the slope of its rays.
cv::Mat_<float> shadow_tops(const cv::Mat_<float>& heights, double gsd_m, const Sun& sun) {
  // Direction of the light in the image (x right, y down).
  const double dx = -std::sin(sun.azimuth_rad), dy = std::cos(sun.azimuth_rad);
  const bool transpose = std::abs(dx) > std::abs(dy);
  cv::Mat_<float> h = transpose ? cv::Mat_<float>(heights.t()) : heights.clone();
  const double major = transpose ? dx : dy, minor = transpose ? dy : dx;
  const double shift = minor / std::abs(major);  // sideways per row
  const auto drop = static_cast<float>(gsd_m * std::tan(sun.elevation_rad) * hypotenuse(1.0, shift));
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
  return slopes;  // slightly larger than the grid; off by less than half a node, which is invisible
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

namespace {

// A sum of hashes approximates the normal distribution of sensor noise.
double noise_of(std::uint64_t seed, std::int64_t column, std::int64_t row) {
  const std::uint64_t h = hash_of(seed, column, row);
  const auto part = [h](int shift) { return static_cast<double>((h >> shift) & 0xFFFF) / 65535.0; };
  return (part(0) + part(16) + part(32) + part(48) - 2.0) * 1.732;
}

void blur(cv::Mat_<cv::Vec3f>& image, double sigma_px) {
  cv::GaussianBlur(image, image, cv::Size(), sigma_px, sigma_px, cv::BORDER_REPLICATE);
}

// Shifts the image by the map's bias, which hardly varies within a piece but must be continuous between pieces.
cv::Mat_<cv::Vec3f> apply_map_bias(const cv::Mat_<cv::Vec3f>& image, const PixelGrid& grid, std::uint64_t seed) {
  cv::Mat_<cv::Vec2f> from(grid.rows, grid.columns);
  constexpr int step = 16;
  cv::Mat_<cv::Vec2f> nodes(grid.rows / step + 2, grid.columns / step + 2);
  for (int r = 0; r < nodes.rows; ++r) {
    for (int c = 0; c < nodes.cols; ++c) {
      const GroundPoint bias = map_bias_m(seed, {grid.x(c * step), grid.y(r * step)});
      nodes(r, c) = {static_cast<float>(-bias.x / grid.gsd_m), static_cast<float>(bias.y / grid.gsd_m)};
    }
  }
  for (int row = 0; row < grid.rows; ++row) {
    const int r = row / step;
    const auto tr = static_cast<float>(row % step) / step;
    for (int column = 0; column < grid.columns; ++column) {
      const int c = column / step;
      const auto tc = static_cast<float>(column % step) / step;
      const cv::Vec2f shift = (nodes(r, c) * (1 - tc) + nodes(r, c + 1) * tc) * (1 - tr) +
                              (nodes(r + 1, c) * (1 - tc) + nodes(r + 1, c + 1) * tc) * tr;
      from(row, column) = {static_cast<float>(column) + shift[0], static_cast<float>(row) + shift[1]};
    }
  }
  cv::Mat_<cv::Vec3f> moved;
  cv::remap(image, moved, from, cv::noArray(), cv::INTER_LINEAR, cv::BORDER_REPLICATE);
  return moved;
}

}  // namespace

GroundPoint map_bias_m(std::uint64_t seed, GroundPoint position) {
  const double angle = 2 * kPi * unit_hash(seed, 501), size = 0.8 + 0.5 * unit_hash(seed, 502);
  const Noise east(hash_of(seed, 503), 900), north(hash_of(seed, 504), 900);
  return {size * std::cos(angle) + 0.6 * east.at(position.x, position.y),
          size * std::sin(angle) + 0.6 * north.at(position.x, position.y)};
}

Sun sun_of(View view) {
  return view == View::satellite ? Sun{radians(148), radians(55)} : Sun{radians(238), radians(39)};
}

cv::Mat_<cv::Vec3b> render_view(const Landscape& land, const Painter& painter, View view, const PixelGrid& grid) {
  const Sun sun = sun_of(view);
  const int rim = static_cast<int>(std::ceil(shadow_reach_m(sun) / grid.gsd_m)) + 8;
  PixelGrid wide = grid;
  wide.first_column -= rim, wide.first_row -= rim, wide.columns += 2 * rim, wide.rows += 2 * rim;
  Painting painting = painter.paint(wide);
  light_painting(painting, wide, land.relief, sun);
  const bool satellite = view == View::satellite;
  cv::Mat_<cv::Vec3f>& image = painting.colour;
  blur(image, satellite ? std::max(0.5, 0.42 / grid.gsd_m) : 0.42);
  if (satellite) image = apply_map_bias(image, wide, land.seed);

  const cv::Vec3d cast = satellite ? cv::Vec3d(1.04, 1.0, 0.93) : cv::Vec3d(1, 1, 1);
  const cv::Vec3d haze = satellite ? cv::Vec3d(0.030, 0.022, 0.015) : cv::Vec3d(0, 0, 0);
  const double clear = satellite ? 0.88 : 1.0, sigma = satellite ? 2.2 : 0.0;
  const std::uint64_t noise_seed = hash_of(land.seed, 600);
  cv::Mat_<cv::Vec3b> result(grid.rows, grid.columns);
  for (int row = 0; row < grid.rows; ++row) {
    for (int column = 0; column < grid.columns; ++column) {
      const cv::Vec3f& light = image(row + rim, column + rim);
      cv::Vec3b& pixel = result(row, column);
      for (int i = 0; i < 3; ++i) {
        const double value = srgb_from_light(static_cast<double>(light[i]) * cast[i] * clear + haze[i]);
        const double noise = sigma > 0 ? sigma * noise_of(noise_seed + static_cast<std::uint64_t>(i),
                                                          grid.first_column + column, grid.first_row + row)
                                       : 0;
        pixel[i] = static_cast<std::uint8_t>(std::clamp(std::lround(value + noise), 1L, 255L));
      }
    }
  }
  return result;
}

}  // namespace nadir
