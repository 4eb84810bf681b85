#include "simulation/world_pictures.hpp"

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>

#include "geodesy/angles.hpp"

namespace nadir {
namespace {

// A sum of hashes is close enough to a normal distribution for a sensor's noise.
double noise_of(std::uint64_t seed, std::int64_t column, std::int64_t row) {
  const std::uint64_t h = hash_of(seed, column, row);
  const auto part = [h](int shift) { return static_cast<double>((h >> shift) & 0xFFFF) / 65535.0; };
  return (part(0) + part(16) + part(32) + part(48) - 2.0) * 1.732;
}

void blur(cv::Mat_<cv::Vec3f>& image, double sigma_px) {
  cv::GaussianBlur(image, image, cv::Size(), sigma_px, sigma_px, cv::BORDER_REPLICATE);
}

// Moves the picture by the map's bias, which hardly varies within a piece but must be continuous between pieces.
cv::Mat_<cv::Vec3f> misplace(const cv::Mat_<cv::Vec3f>& image, const PixelGrid& grid, std::uint64_t seed) {
  cv::Mat_<cv::Vec2f> from(grid.rows, grid.columns);
  constexpr int step = 16;
  cv::Mat_<cv::Vec2f> nodes(grid.rows / step + 2, grid.columns / step + 2);
  for (int r = 0; r < nodes.rows; ++r) {
    for (int c = 0; c < nodes.cols; ++c) {
      const Spot bias = map_bias_m(seed, {grid.x(c * step), grid.y(r * step)});
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

Spot map_bias_m(std::uint64_t seed, Spot spot) {
  const double angle = 2 * kPi * unit_hash(seed, 501), size = 0.8 + 0.5 * unit_hash(seed, 502);
  const Noise east(hash_of(seed, 503), 900), north(hash_of(seed, 504), 900);
  return {size * std::cos(angle) + 0.6 * east.at(spot.x, spot.y),
          size * std::sin(angle) + 0.6 * north.at(spot.x, spot.y)};
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
  if (satellite) image = misplace(image, wide, land.seed);

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
