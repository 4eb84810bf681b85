// Where map tiles come from: encoded bytes by address. MBTiles and COG files implement it; so does the package, which
// also checks each tile's digest before it hands the bytes out.
#pragma once

#include <optional>

#include "base/bytes.hpp"
#include "geodesy/web_mercator.hpp"

namespace nadir {

struct ZoomRange {
  int min = 0;
  int max = 0;
};

class TileSource {
 public:
  virtual ~TileSource() = default;
  virtual ZoomRange zooms() const = 0;
  // The tile's encoded bytes; nullopt when the set does not hold it. Throws Error when the set cannot be read.
  virtual std::optional<Bytes> read(const TileKey& key) const = 0;
  // Which pixels of the tile show ground: a PNG of one channel, 255 where they do. nullopt when the set does not say;
  // then all do, unless the tile itself is transparent. (JPEG has no transparency; its rim tiles need this.)
  virtual std::optional<Bytes> read_mask(const TileKey& /*key*/) const { return std::nullopt; }
};

}  // namespace nadir
