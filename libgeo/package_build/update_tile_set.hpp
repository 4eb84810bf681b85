// The tiles of an old package and new imagery to a new MBTiles file or COG. The same inputs give the same bytes for any
// number of threads; an update whose imagery covers everything gives the bytes of a build.
#pragma once

#include <filesystem>

#include "base/progress.hpp"
#include "package_build/tile_set_builder.hpp"
#include "package_build/update_metatile.hpp"

namespace nadir {

struct UpdatedTileSet {
  TileSet set;
  UpdateCounts counts;
};

// What reading the old tiles met is in old.findings() afterwards. options.encoding: as the old tiles are.
UpdatedTileSet update_tile_set(const Mission& mission, const OldMap& old, const UpdateLayers& layers,
                               const TileRange& range, const TileSetOptions& options, const std::filesystem::path& file,
                               Progress& progress);

}  // namespace nadir
