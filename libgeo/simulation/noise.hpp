// Smooth and white noise as functions of the position alone, so that any part of a landscape can be painted by itself.
//
// Gradient noise after Perlin (2002): values roughly in [-1, 1] with mean 0 and a standard deviation of about 0.35.
#pragma once

#include <cstdint>
#include <opencv2/core/mat.hpp>

namespace nadir {

// A piece of an image's pixel grid. x grows east and y north, in metres from the world's south-west corner; rows grow
// south. Columns and rows are counted in the whole image, so that every piece sees the same numbers.
struct PixelGrid {
  double gsd_m = 1;
  double height_m = 0;  // of the whole image: y of its northern edge
  int first_column = 0;
  int first_row = 0;
  int columns = 0;
  int rows = 0;

  double x(int column) const { return (first_column + column + 0.5) * gsd_m; }
  double y(int row) const { return height_m - (first_row + row + 0.5) * gsd_m; }
  double column_of(double x_m) const { return x_m / gsd_m - 0.5 - first_column; }
  double row_of(double y_m) const { return (height_m - y_m) / gsd_m - 0.5 - first_row; }
};

std::uint64_t hash_of(std::uint64_t seed, std::int64_t a, std::int64_t b = 0);

// In [0, 1).
inline double unit_hash(std::uint64_t seed, std::int64_t a, std::int64_t b = 0) {
  return static_cast<double>(hash_of(seed, a, b) >> 11) * 0x1.0p-53;
}

class Noise {
 public:
  Noise(std::uint64_t seed, double wavelength_m) : seed_(seed), frequency_(1 / wavelength_m) {}

  double at(double x_m, double y_m) const;
  // Adds amplitude · noise to every pixel of `out` (columns × rows of the grid).
  void add(const PixelGrid& grid, double amplitude, cv::Mat_<float>& out) const;

 private:
  std::uint64_t seed_;
  double frequency_;
};

}  // namespace nadir
