#include "simulation/noise.hpp"

#include <array>
#include <cmath>
#include <numbers>

namespace nadir {
namespace {

constexpr double kScale = 1.5;

struct Gradient {
  double x, y;
};

const std::array<Gradient, 64>& gradients() {
  static const std::array<Gradient, 64> table = [] {
    std::array<Gradient, 64> result{};
    for (std::size_t i = 0; i < result.size(); ++i) {
      const double angle = 2 * std::numbers::pi * (static_cast<double>(i) + 0.5) / 64;
      result[i] = {std::cos(angle), std::sin(angle)};
    }
    return result;
  }();
  return table;
}

Gradient gradient_at(std::uint64_t seed, std::int64_t ix, std::int64_t iy) {
  return gradients()[hash_of(seed, ix, iy) >> 58];
}

double fade(double t) { return t * t * t * (t * (t * 6 - 15) + 10); }

}  // namespace

std::uint64_t hash_of(std::uint64_t seed, std::int64_t a, std::int64_t b) {
  std::uint64_t h = seed + static_cast<std::uint64_t>(a) * 0x9E3779B97F4A7C15ULL;
  h = (h ^ (h >> 30)) * 0xBF58476D1CE4E5B9ULL + static_cast<std::uint64_t>(b) * 0xD6E8FEB86659FD93ULL;
  h = (h ^ (h >> 27)) * 0x94D049BB133111EBULL;
  return h ^ (h >> 31);
}

double Noise::at(double x_m, double y_m) const {
  const double x = x_m * frequency_, y = y_m * frequency_;
  const double fx = std::floor(x), fy = std::floor(y);
  const auto ix = static_cast<std::int64_t>(fx), iy = static_cast<std::int64_t>(fy);
  const double tx = x - fx, ty = y - fy;
  const Gradient a = gradient_at(seed_, ix, iy), b = gradient_at(seed_, ix + 1, iy);
  const Gradient c = gradient_at(seed_, ix, iy + 1), d = gradient_at(seed_, ix + 1, iy + 1);
  const double u = fade(tx), v = fade(ty);
  const double low = std::lerp(a.x * tx + a.y * ty, b.x * (tx - 1) + b.y * ty, u);
  const double high = std::lerp(c.x * tx + c.y * (ty - 1), d.x * (tx - 1) + d.y * (ty - 1), u);
  return kScale * std::lerp(low, high, v);
}

void Noise::add(const PixelGrid& grid, double amplitude, cv::Mat_<float>& out) const {
  const double step = grid.gsd_m * frequency_;
  const double gain = amplitude * kScale;
  for (int row = 0; row < grid.rows; ++row) {
    float* values = out[row];
    const double y = grid.y(row) * frequency_;
    const double fy = std::floor(y);
    const auto iy = static_cast<std::int64_t>(fy);
    const double ty = y - fy, v = fade(ty);
    int column = 0;
    while (column < grid.columns) {
      // Within one cell of the lattice the four gradients stay: the row is a run of cells.
      const double start = grid.x(column) * frequency_;
      const double fx = std::floor(start);
      const auto ix = static_cast<std::int64_t>(fx);
      const Gradient a = gradient_at(seed_, ix, iy), b = gradient_at(seed_, ix + 1, iy);
      const Gradient c = gradient_at(seed_, ix, iy + 1), d = gradient_at(seed_, ix + 1, iy + 1);
      // At the left edge: value and slope along x of each corner's plane, mixed over y already.
      const double left_x = a.x + v * (c.x - a.x), left_0 = a.y * ty + v * (c.y * (ty - 1) - a.y * ty);
      const double right_x = b.x + v * (d.x - b.x), right_0 = b.y * ty + v * (d.y * (ty - 1) - b.y * ty);
      do {
        const double tx = grid.x(column) * frequency_ - fx;
        if (tx >= 1) break;
        const double left = left_0 + left_x * tx, right = right_0 + right_x * (tx - 1);
        values[column] += static_cast<float>(gain * (left + fade(tx) * (right - left)));
        ++column;
      } while (column < grid.columns);
      if (step >= 1 && column < grid.columns && grid.x(column) * frequency_ - fx < 1) ++column;
    }
  }
}

}  // namespace nadir
