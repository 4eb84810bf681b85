// Heights of the ground on a grid of longitude and latitude: a package's terrain/dem.tif, read without GDAL.
//
// The file is a GeoTIFF of float32 metres in EPSG:4326, tiled, plain or deflated, with one nodata
// value (docs/formats.md). Anything else is an Error: files may come from anywhere, so sizes are bounded before memory
// is allocated, and only finite values are accepted.
#pragma once

#include <cstddef>
#include <filesystem>
#include <optional>
#include <span>
#include <string_view>
#include <vector>

#include "base/bytes.hpp"
#include "geodesy/lon_lat.hpp"

namespace nadir {

inline constexpr int kMaxTerrainSide = 20'000;                 // posts
inline constexpr std::size_t kMaxTerrainPosts = 100'000'000;   // 400 MB of heights
inline constexpr std::uint64_t kMaxTerrainFile = 420'000'000;  // bytes
inline constexpr double kLowestGround_m = -500, kHighestGround_m = 9000;

// Heights are those of the cells' centres, the posts. The outer edge of the grid is half a step beyond the first and
// last posts.
struct TerrainGrid {
  double west_deg = 0;   // outer edge
  double north_deg = 0;  // outer edge
  double lon_step_deg = 0;
  double lat_step_deg = 0;  // positive, southwards
  int columns = 0;
  int rows = 0;

  double east_deg() const { return west_deg + columns * lon_step_deg; }
  double south_deg() const { return north_deg - rows * lat_step_deg; }
  std::size_t posts() const { return static_cast<std::size_t>(columns) * static_cast<std::size_t>(rows); }
  // In units of posts: 0 at the first post, -0.5 at the outer edge.
  double column_of(double lon_deg) const { return (lon_deg - west_deg) / lon_step_deg - 0.5; }
  double row_of(double lat_deg) const { return (north_deg - lat_deg) / lat_step_deg - 0.5; }
  LonLat place(double column, double row) const {
    return {west_deg + (column + 0.5) * lon_step_deg, north_deg - (row + 0.5) * lat_step_deg};
  }
};

class TerrainRaster {
 public:
  // heights_m: by rows from the north; NaN where the height is not known. Throws Error for an invalid grid.
  TerrainRaster(const TerrainGrid& grid, std::vector<float> heights_m);

  const TerrainGrid& grid() const { return grid_; }
  std::span<const float> heights_m() const { return heights_m_; }

  // Bilinear between the posts, the nearest post's in the half step outside of them. Nothing beyond the grid, and
  // nothing where one of the posts is unknown.
  std::optional<double> height_m(LonLat place) const;

  // Known at all posts of these columns and rows, both ends included, and all of them inside the grid.
  bool known(int first_column, int first_row, int last_column, int last_row) const;

 private:
  TerrainGrid grid_;
  std::vector<float> heights_m_;
};

// name: for messages.
TerrainRaster parse_terrain_raster(ByteView file, std::string_view name);
TerrainRaster read_terrain_raster(const std::filesystem::path& path);

}  // namespace nadir
