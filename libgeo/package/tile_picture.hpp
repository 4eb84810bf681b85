// What one tile's picture says about itself once it is decoded.
#pragma once

#include <cstdint>
#include <optional>

#include "base/bytes.hpp"
#include "base/error.hpp"
#include "geodesy/web_mercator.hpp"

namespace nadir {

struct TilePicture {
  std::optional<Finding> problem;  // tile.undecodable, tile.size, tile.blank, tile.fill
  std::int64_t valid_ppm = 0;      // share of pixels that are neither transparent nor fill
  Bytes mask;                      // kTileSize² bytes, 255 valid; empty when all are
};

TilePicture inspect_tile(ByteView tile, const TileKey& key);

}  // namespace nadir
