// The tiles of an old package and new imagery to a new MBTiles file. The same inputs give the same bytes for any number
// of threads; an update whose imagery covers everything gives the bytes of a build.
#pragma once

#include <filesystem>

#include "base/progress.hpp"
#include "ground/tile_set_builder.hpp"
#include "ground/update_metatile.hpp"

namespace nadir {

struct UpdatedTileSet {
  TileSet set;
  UpdateCounts counts;
};

// What reading the old tiles met is in old.findings() afterwards. options.encoding.format: the old one's.
UpdatedTileSet update_tile_set(const Mission& mission, const OldMap& old, const UpdateLayers& layers,
                               const TileRange& range, const TileSetOptions& options,
                               const std::filesystem::path& mbtiles, Progress& progress);

}  // namespace nadir
