#include "imagery/terrain_raster.hpp"

#include <fmt/format.h>
#include <tiffio.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <string>

#include "base/error.hpp"
#include "base/files.hpp"
#include "base/number_text.hpp"
#include "base/printable.hpp"
#include "imagery/tiff_memory.hpp"

namespace nadir {
namespace {

constexpr std::uint32_t kTagNodata = 42113;
constexpr std::uint32_t kMaxTileSide = 2048;
constexpr tmsize_t kMaxAllocation = tmsize_t{64} << 20;  // no block of a valid file needs more

class TerrainTiff {
 public:
  TerrainTiff(ByteView file, std::string_view name)
      : file_(file, name, {"terrain file", "create it from the elevation model with `nadir cache build --dem`"},
              kMaxAllocation) {}

  TerrainRaster read() {
    file_.check_layout(true, 1, PLANARCONFIG_CONTIG);
    read_size();
    read_grid();
    const float nodata = read_nodata();
    return {grid_, read_heights(nodata)};
  }

 private:
  void read_size() {
    const std::uint32_t columns = file_.number(TIFFTAG_IMAGEWIDTH), rows = file_.number(TIFFTAG_IMAGELENGTH);
    if (columns < 1 || rows < 1 || columns > kMaxTerrainSide || rows > kMaxTerrainSide ||
        std::size_t{columns} * rows > kMaxTerrainPosts) {
      file_.refuse(fmt::format("1 to {} posts a side, {} in all", kMaxTerrainSide, kMaxTerrainPosts),
                   fmt::format("{} x {}", columns, rows));
    }
    grid_.columns = static_cast<int>(columns);
    grid_.rows = static_cast<int>(rows);
    tile_columns_ = file_.number(TIFFTAG_TILEWIDTH);
    tile_rows_ = file_.number(TIFFTAG_TILELENGTH);
    if (tile_columns_ < 16 || tile_rows_ < 16 || tile_columns_ > kMaxTileSide || tile_rows_ > kMaxTileSide) {
      file_.refuse(fmt::format("tiles of 16 to {} posts a side", kMaxTileSide),
                   fmt::format("{} x {}", tile_columns_, tile_rows_));
    }
  }

  void read_grid() {
    const StrictGeoTiff::NorthUp grid = file_.north_up();
    constexpr std::uint16_t kModelType = 1024, kRasterType = 1025, kGeographicType = 2048;
    const std::uint16_t model = file_.geo_key(kModelType), raster = file_.geo_key(kRasterType),
                        geographic = file_.geo_key(kGeographicType);
    if (model != 2 || raster != 1 || geographic != 4326) {
      file_.refuse("EPSG:4326, pixels as areas",
                   fmt::format("model type {}, raster type {}, geographic type {}", model, raster, geographic));
    }
    grid_.west_deg = grid.west, grid_.north_deg = grid.north;
    grid_.lon_step_deg = grid.column_step, grid_.lat_step_deg = grid.row_step;
  }

  float read_nodata() const {
    const std::string_view text = file_.text(kTagNodata);
    if (text.empty()) file_.refuse("a stated nodata value", "none");
    const auto value = finite_number<float>(text);
    if (!value) file_.refuse("a finite number as nodata", printable(text.substr(0, 32)));
    return *value;
  }

  std::vector<float> read_heights(float nodata) {
    const tmsize_t tile_size = static_cast<tmsize_t>(std::size_t{tile_columns_} * tile_rows_ * sizeof(float));
    if (TIFFTileSize(file_.tiff()) != tile_size) file_.refuse("tiles of float32", "tiles of another size");
    std::vector<float> heights(grid_.posts());
    std::vector<float> tile(std::size_t{tile_columns_} * tile_rows_);
    const auto columns = static_cast<std::uint32_t>(grid_.columns), rows = static_cast<std::uint32_t>(grid_.rows);
    for (std::uint32_t top = 0; top < rows; top += tile_rows_) {
      for (std::uint32_t left = 0; left < columns; left += tile_columns_) {
        const std::uint32_t index = TIFFComputeTile(file_.tiff(), left, top, 0, 0);
        if (TIFFReadEncodedTile(file_.tiff(), index, tile.data(), tile_size) != tile_size) {
          file_.refuse(fmt::format("a complete tile at column {}, row {}", left, top), file_.complaint());
        }
        const std::uint32_t width = std::min(tile_columns_, columns - left);
        for (std::uint32_t row = top; row < std::min(rows, top + tile_rows_); ++row) {
          const float* from = tile.data() + std::size_t{row - top} * tile_columns_;
          take_row({from, width}, nodata, heights.data() + std::size_t{row} * columns + left, row, left);
        }
      }
    }
    return heights;
  }

  void take_row(std::span<const float> from, float nodata, float* into, std::uint32_t row, std::uint32_t left) const {
    for (std::size_t i = 0; i < from.size(); ++i) {
      if (!std::isfinite(from[i])) {
        file_.refuse("finite heights", fmt::format("{} at column {}, row {}", from[i], left + i, row));
      }
      into[i] = from[i] == nodata ? std::numeric_limits<float>::quiet_NaN() : from[i];
    }
  }

  StrictGeoTiff file_;
  TerrainGrid grid_;
  std::uint32_t tile_columns_ = 0, tile_rows_ = 0;
};

void check_grid(const TerrainGrid& grid, std::size_t heights) {
  const auto refuse = [](std::string expected, std::string found) {
    throw Error({.what = "the height grid is invalid", .expected = std::move(expected), .found = std::move(found)});
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

TerrainRaster parse_terrain_raster(ByteView file, std::string_view name) { return TerrainTiff(file, name).read(); }

TerrainRaster read_terrain_raster(const std::filesystem::path& path) {
  return parse_terrain_raster(read_file(path, kMaxTerrainFile), path.string());
}

}  // namespace nadir
