// Checks the encoded image of one tile: whether it decodes, its size, and which of its pixels show ground.
//
// A pixel shows ground when it is neither transparent nor fill. Fill is black or white at the tile's edge: what tools
// write into JPEG tiles, which have no transparency, where their source ends. It looks like coverage and shows nothing.
// Fill is found in blocks of 16 x 16 pixels, the unit in which JPEG works: a block counts when all of its pixels are
// within 3 levels of black (or all of white) and it connects to the tile's edge through such blocks. So a shadow or a
// roof inside the image is not fill; a black lake or a burnt-out cloud at the edge is, and shows as little ground.
#pragma once

#include <cstdint>
#include <optional>

#include "base/bytes.hpp"
#include "base/error.hpp"
#include "geodesy/web_mercator.hpp"

namespace nadir {

struct TileImageCheck {
  std::optional<Finding> problem;  // tile.undecodable, tile.size, tile.blank, tile.fill
  std::int64_t valid_ppm = 0;      // share of pixels that are neither transparent nor fill
  Bytes mask;                      // kTileSize² bytes, 255 valid; empty when all are
};

// From the header alone: tile.undecodable, tile.size. nullopt: nothing is wrong.
std::optional<Finding> tile_header_problem(ByteView tile, const TileKey& key);

TileImageCheck check_tile_image(ByteView tile, const TileKey& key);

// A validity mask as sidecars hold it: a grey PNG of kTileSize² pixels, 255 where the tile shows ground. Decoded:
// kTileSize² bytes in rows; nullopt when the bytes are no such PNG.
std::optional<Bytes> decode_tile_mask(ByteView png);

// The inverse; deterministic.
Bytes encode_tile_mask(ByteView pixels);

}  // namespace nadir
