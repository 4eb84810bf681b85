// A source of map tiles: encoded bytes by address. MBTiles and COG files implement it; so does the package, which
// verifies each tile's digest before it returns the bytes.
#pragma once

#include <optional>

#include "base/bytes.hpp"
#include "geodesy/web_mercator.hpp"

namespace nadir {

struct ZoomRange {
  int min = 0;
  int max = 0;

  bool operator==(const ZoomRange&) const = default;
};

class TileSource {
 public:
  virtual ~TileSource() = default;
  virtual ZoomRange zooms() const = 0;
  // The tile's encoded bytes; nullopt when the set does not hold it. Throws Error when the set cannot be read.
  virtual std::optional<Bytes> read(const TileKey& key) const = 0;
  // Valid pixels of the tile: a PNG of one channel, 255 where the tile shows ground. nullopt when there is no mask;
  // then all pixels are valid unless the tile itself is transparent. (JPEG has no transparency; its edge tiles need
  // this.)
  virtual std::optional<Bytes> read_mask(const TileKey& /*key*/) const { return std::nullopt; }
  // The circular error of the tile's placement on the ground, 90 %; nullopt where it is not stated.
  virtual std::optional<double> ce90_m(const TileKey& /*key*/) const { return std::nullopt; }
};

}  // namespace nadir
