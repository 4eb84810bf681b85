// How well frames can be matched with the map, by ground: a package's matchability/matchability.tif, read without GDAL.
//
// The file is a GeoTIFF of six float32 bands in EPSG:3857, in strips, plain or deflated (docs/formats/matchability.md).
// Of these only the class is read. Anything else is an Error: files may come from anywhere, so sizes are bounded before
// memory is allocated, and only known classes are accepted.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string_view>
#include <vector>

#include "base/bytes.hpp"
#include "geodesy/lon_lat.hpp"
#include "geodesy/web_mercator.hpp"

namespace nadir {

enum class MatchClass : std::uint8_t {
  outside = 0,  // not evaluated
  good = 1,     // a frame may anchor on its own
  weak = 2,     // only where a healthy prediction agrees
  poor = 3,     // no anchor is to be expected
};

inline constexpr std::size_t kMaxMatchabilityCells = 1'000'000;
inline constexpr std::uint64_t kMaxMatchabilityFile = 32'000'000;  // bytes; six floats a cell, plain
inline constexpr float kMatchabilityNodata = -1;

// Squares in Web Mercator, rows from the north.
struct MatchabilityCells {
  MercatorXY north_west;
  double side_m = 0;  // Mercator metres
  int columns = 0, rows = 0;
  std::vector<MatchClass> classes;
};

class MatchabilityRaster {
 public:
  // Throws Error for a grid that is none, or another number of classes than cells.
  explicit MatchabilityRaster(MatchabilityCells cells);

  MatchClass at(LonLat position) const;  // outside: beyond the grid as well
  const MatchabilityCells& cells() const { return cells_; }

 private:
  MatchabilityCells cells_;
};

// name: for messages. Throws Error.
MatchabilityRaster parse_matchability_raster(ByteView file, std::string_view name);

}  // namespace nadir
