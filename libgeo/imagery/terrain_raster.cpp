#include "imagery/terrain_raster.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "base/error.hpp"
#include "base/files.hpp"

namespace nadir {
namespace {

void check_grid(const TerrainGrid& grid, std::size_t heights) {
  const auto refuse = [](std::string expected, std::string found) {
    throw Error(
        {.what = "the grid of heights is not usable", .expected = std::move(expected), .found = std::move(found)});
  };
  if (grid.columns < 1 || grid.rows < 1 || grid.columns > kMaxTerrainSide || grid.rows > kMaxTerrainSide ||
      grid.posts() > kMaxTerrainPosts) {
    refuse(fmt::format("1 to {} posts a side, {} in all", kMaxTerrainSide, kMaxTerrainPosts),
           fmt::format("{} x {}", grid.columns, grid.rows));
  }
  if (grid.posts() != heights) refuse(fmt::format("{} heights", grid.posts()), fmt::format("{}", heights));
  const auto usable_step = [](double step) { return step >= 1e-7 && step <= 1; };
  if (!usable_step(grid.lon_step_deg) || !usable_step(grid.lat_step_deg)) {
    refuse("steps from 1e-7 to 1 degree", fmt::format("{} and {}", grid.lon_step_deg, grid.lat_step_deg));
  }
  constexpr double kRounding_deg = 1e-6;
  const bool on_earth = grid.west_deg >= -180 - kRounding_deg && grid.east_deg() <= 180 + kRounding_deg &&
                        grid.north_deg <= 90 + kRounding_deg && grid.south_deg() >= -90 - kRounding_deg;
  if (!on_earth) {
    refuse("longitudes from -180 to 180 and latitudes from -90 to 90",
           fmt::format("{} to {} and {} to {}", grid.west_deg, grid.east_deg(), grid.south_deg(), grid.north_deg));
  }
}

}  // namespace

TerrainRaster::TerrainRaster(const TerrainGrid& grid, std::vector<float> heights_m)
    : grid_(grid), heights_m_(std::move(heights_m)) {
  check_grid(grid_, heights_m_.size());
}

std::optional<double> TerrainRaster::height_m(LonLat place) const {
  double column = grid_.column_of(place.lon_deg), row = grid_.row_of(place.lat_deg);
  if (!(column >= -0.5 && column <= grid_.columns - 0.5 && row >= -0.5 && row <= grid_.rows - 0.5)) return std::nullopt;
  column = std::clamp(column, 0.0, grid_.columns - 1.0);
  row = std::clamp(row, 0.0, grid_.rows - 1.0);
  const int c = static_cast<int>(column), r = static_cast<int>(row);
  const double u = column - c, v = row - r;
  double height = 0;
  const auto take = [&](int at_column, int at_row, double weight) {
    if (weight > 0)
      height += weight * static_cast<double>(
                             heights_m_[static_cast<std::size_t>(at_row) * static_cast<std::size_t>(grid_.columns) +
                                        static_cast<std::size_t>(at_column)]);
  };
  take(c, r, (1 - u) * (1 - v));
  take(c + 1, r, u * (1 - v));
  take(c, r + 1, (1 - u) * v);
  take(c + 1, r + 1, u * v);
  if (std::isnan(height)) return std::nullopt;
  return height;
}

bool TerrainRaster::known(int first_column, int first_row, int last_column, int last_row) const {
  if (first_column < 0 || first_row < 0 || last_column >= grid_.columns || last_row >= grid_.rows) return false;
  for (int row = first_row; row <= last_row; ++row) {
    const auto begin = heights_m_.begin() + static_cast<std::ptrdiff_t>(row) * grid_.columns;
    if (std::any_of(begin + first_column, begin + last_column + 1, [](float h) { return std::isnan(h); })) return false;
  }
  return true;
}

TerrainRaster read_terrain_raster(const std::filesystem::path& path) {
  return parse_terrain_raster(read_file(path, kMaxTerrainFile), path.string());
}

}  // namespace nadir
