// Small rasters of every kind, written with GDAL for the tests.
#pragma once

#include <array>
#include <filesystem>
#include <functional>
#include <optional>
#include <string>

namespace nadir::test {

enum class Kind { grey, palette, rgb, rgba, rgb_nir, uint16 };

struct RasterSpec {
  int width = 512;
  int height = 512;
  Kind kind = Kind::rgb;
  int epsg = 32651;  // UTM 51 N; 0: none
  std::optional<std::array<double, 6>> transform = {{268'000, 0.3, 0, 2'685'300, 0, -0.3}};
  std::optional<double> nodata{};
  std::function<bool(int column, int row)> masked_out{};  // into a per-dataset mask
  bool tiled = false;
};

// colour: red, green, blue, alpha (palette: the index in red).
using ColourAt = std::function<std::array<int, 4>(int column, int row)>;
void write_raster(const std::filesystem::path& path, const RasterSpec& spec, const ColourAt& colour);

// The STAC Item beside it.
void write_item(const std::filesystem::path& raster, const std::string& datetime = "2024-03-01T00:00:00Z",
                double gsd_m = 0.3, const std::string& provider = "survey");

// Web Mercator of a point of another reference system, by PROJ itself.
struct ProjectedPoint {
  double x = 0, y = 0;
};
ProjectedPoint project(int from_epsg, const char* to, ProjectedPoint point);

}  // namespace nadir::test
