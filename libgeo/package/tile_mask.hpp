// A validity mask as it lies in a sidecar: a grey PNG of kTileSize² pixels, 255 where the tile shows ground.
#pragma once

#include <optional>

#include "base/bytes.hpp"

namespace nadir {

// kTileSize² bytes in rows; nullopt when the bytes are no such PNG.
std::optional<Bytes> decode_tile_mask(ByteView png);

// The same back; deterministic.
Bytes encode_tile_mask(ByteView pixels);

}  // namespace nadir
