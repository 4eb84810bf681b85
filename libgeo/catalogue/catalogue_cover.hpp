// Areas as pixels of map tiles: which pixel centres lie in them.
#pragma once

#include <cstdint>
#include <vector>

#include "base/bytes.hpp"
#include "geodesy/web_mercator.hpp"
#include "catalogue/catalogue_area.hpp"

namespace nadir {

class PixelCover {
 public:
  // Knows the tiles of one zoom and of these tile rows; what lies beyond costs nothing. Edges are taken for straight on
  // the Web Mercator map.
  PixelCover(int zoom, std::uint32_t first_tile_row, std::uint32_t last_tile_row);

  // Areas may overlap.
  void add(const GeoArea& area);

  // kTileSize² bytes in rows, 255 where the pixel's centre lies in one of the areas.
  Bytes pixels(const TileKey& key) const;

 private:
  struct Span {
    std::int64_t begin = 0, end = 0;  // columns of global pixels; the end is outside
  };
  void add_polygon(const GeoPolygon& polygon);

  int zoom_;
  std::int64_t first_row_;                // of global pixels
  std::vector<std::vector<Span>> spans_;  // of each row, in no order
};

}  // namespace nadir
