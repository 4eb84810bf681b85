// One metatile of an updated map: tiles in which new imagery shows are made anew, with the overviews above them; all
// others are copied.
#pragma once

#include "package_build/update_layers.hpp"

namespace nadir {

struct UpdateCounts {
  std::uint64_t copied = 0;     // with the old bytes
  std::uint64_t reencoded = 0;  // at addresses that the old package had as well
  std::uint64_t added = 0;      // at addresses that it had not
  std::uint64_t dropped = 0;    // of the old package, no longer required

  UpdateCounts& operator+=(const UpdateCounts& other);
};

// What everything in an update refers to; all of it outlives the work.
struct UpdateWork {
  const OldMap& old;
  const UpdateLayers& layers;
  const TileRange& range;  // wanted tiles of the finest zoom
  const TileEncoder& encoder;
  double feather_px = 0;
};

struct UpdatedMetatile {
  Metatile metatile;
  UpdateCounts counts;
  bool changed = false;  // at least one tile is not a copy
};

UpdatedMetatile update_metatile(const TileKey& key, const UpdateWork& work, std::span<const LayerReader> readers);

// The old tile when it is to stay and there is one, else the tile anew; counts which of both it was.
EncodedTile copy_or_encode(const UpdateWork& work, const TileKey& key, const TileCanvas& tile, bool stays,
                           UpdateCounts& counts);

}  // namespace nadir
