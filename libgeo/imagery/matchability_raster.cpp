#include "imagery/matchability_raster.hpp"

#include <fmt/format.h>
#include <tiffio.h>

#include <algorithm>
#include <cmath>
#include <string>
#include <utility>

#include "base/error.hpp"
#include "imagery/tiff_memory.hpp"

namespace nadir {
namespace {

constexpr std::uint16_t kBands = 6, kClassBand = 3;
constexpr tmsize_t kMaxStrip = tmsize_t{8} << 20;  // a strip holds all cells at most
constexpr double kWorld_m = 20037508.342789244;    // half of Web Mercator's side
constexpr double kLeastCell_m = 0.1;

class MatchabilityTiff {
 public:
  MatchabilityTiff(ByteView file, std::string_view name)
      : file_(file, name, {"matchability map", "make it again with `nadir cache matchability --into-package`"},
              kMaxStrip) {}

  MatchabilityRaster read() {
    file_.check_layout(false, kBands, PLANARCONFIG_SEPARATE);
    read_grid();
    read_classes();
    return MatchabilityRaster(std::move(cells_));
  }

 private:
  void read_grid() {
    const std::uint32_t columns = file_.number(TIFFTAG_IMAGEWIDTH), rows = file_.number(TIFFTAG_IMAGELENGTH);
    if (columns < 1 || rows < 1 || std::uint64_t{columns} * rows > kMaxMatchabilityCells) {
      file_.refuse(fmt::format("1 to {} cells", kMaxMatchabilityCells), fmt::format("{} x {}", columns, rows));
    }
    cells_.columns = static_cast<int>(columns);
    cells_.rows = static_cast<int>(rows);

    const StrictGeoTiff::NorthUp grid = file_.north_up();
    if (grid.column_step != grid.row_step) {
      file_.refuse("square cells", fmt::format("{} x {} m", grid.column_step, grid.row_step));
    }
    constexpr std::uint16_t kRasterType = 1025, kProjection = 3072;
    const std::uint16_t raster = file_.geo_key(kRasterType), projection = file_.geo_key(kProjection);
    if (raster != 1 || projection != 3857) {
      file_.refuse("EPSG:3857, pixels as areas", fmt::format("projection {}, raster type {}", projection, raster));
    }
    cells_.north_west = {grid.west, grid.north};
    cells_.side_m = grid.column_step;
  }

  void read_classes() {
    const auto columns = static_cast<std::size_t>(cells_.columns), rows = static_cast<std::size_t>(cells_.rows);
    std::vector<float> row(columns);
    if (static_cast<std::size_t>(TIFFScanlineSize(file_.tiff())) != columns * sizeof(float)) {
      file_.refuse("rows of float32", "rows of another size");
    }
    cells_.classes.reserve(columns * rows);
    for (std::size_t r = 0; r < rows; ++r) {
      if (TIFFReadScanline(file_.tiff(), row.data(), static_cast<std::uint32_t>(r), kClassBand) != 1) {
        file_.refuse(fmt::format("a complete row {}", r), file_.complaint());
      }
      for (const float value : row) {
        if (value != kMatchabilityNodata && value != 1 && value != 2 && value != 3) {
          file_.refuse("classes 1, 2, 3, or -1 for none", fmt::format("{} in row {}", value, r));
        }
        cells_.classes.push_back(value < 0 ? MatchClass::outside : static_cast<MatchClass>(static_cast<int>(value)));
      }
    }
  }

  StrictGeoTiff file_;
  MatchabilityCells cells_;
};

}  // namespace

MatchabilityRaster::MatchabilityRaster(MatchabilityCells cells) : cells_(std::move(cells)) {
  const MatchabilityCells& c = cells_;
  const auto refuse = [](std::string expected, std::string found) {
    throw Error(
        {.what = "the grid of matchability is invalid", .expected = std::move(expected), .found = std::move(found)});
  };
  if (c.columns < 1 || c.rows < 1 ||
      c.classes.size() != static_cast<std::size_t>(c.columns) * static_cast<std::size_t>(c.rows)) {
    refuse(fmt::format("{} x {} cells", c.columns, c.rows), fmt::format("{}", c.classes.size()));
  }
  const auto on_earth = [](double m) { return std::abs(m) <= kWorld_m + 1; };  // NaN is not
  if (!(c.side_m >= kLeastCell_m) || !on_earth(c.north_west.x_m) || !on_earth(c.north_west.y_m) ||
      !on_earth(c.north_west.x_m + c.columns * c.side_m) || !on_earth(c.north_west.y_m - c.rows * c.side_m)) {
    refuse(fmt::format("cells of {} m or more within the Web Mercator square", kLeastCell_m),
           fmt::format("{} x {} of {} m from {}, {}", c.columns, c.rows, c.side_m, c.north_west.x_m, c.north_west.y_m));
  }
}

MatchClass MatchabilityRaster::at(LonLat position) const {
  const MercatorXY place = mercator_from_lonlat(position);
  const double column = std::floor((place.x_m - cells_.north_west.x_m) / cells_.side_m);
  const double row = std::floor((cells_.north_west.y_m - place.y_m) / cells_.side_m);
  if (!(column >= 0 && row >= 0 && column < cells_.columns && row < cells_.rows)) return MatchClass::outside;
  return cells_.classes[static_cast<std::size_t>(row) * static_cast<std::size_t>(cells_.columns) +
                        static_cast<std::size_t>(column)];
}

MatchabilityRaster parse_matchability_raster(ByteView file, std::string_view name) {
  return MatchabilityTiff(file, name).read();
}

}  // namespace nadir
