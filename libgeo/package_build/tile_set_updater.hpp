// The tiles of an old package and new imagery to a new MBTiles file or COG.
//
// New rasters and old tiles are ordered by the same rule as the rasters of a build. Old tiles are grouped by origin
// (one source, date and accuracy); each origin is ordered like a raster. Tiles in which new imagery shows are made
// again, with the overviews above them; all others are copied byte for byte. The same inputs give the same bytes for
// any number of threads; an update whose imagery covers everything gives the bytes of a build.
#pragma once

#include <cstdint>
#include <filesystem>
#include <span>
#include <vector>

#include "base/error.hpp"
#include "base/progress.hpp"
#include "package_build/tile_set_builder.hpp"

namespace nadir {

struct UpdateCounts {
  std::uint64_t copied = 0;     // with the old bytes
  std::uint64_t reencoded = 0;  // at addresses that the old package had as well
  std::uint64_t added = 0;      // at addresses that it had not
  std::uint64_t dropped = 0;    // of the old package, no longer required

  UpdateCounts& operator+=(const UpdateCounts& other);
};

// The tiles of the package that is updated.
struct OldTileSet {
  std::filesystem::path file;     // MBTiles or COG
  std::vector<Sidecar> sidecars;  // verified, in the order of TileKey
};

struct UpdatedTileSet {
  TileSet set;
  UpdateCounts counts;
  Findings findings;  // of reading the old tiles: artifact.hash, sqlite.corrupt, tile.undecodable
};

// range: the wanted tiles of the finest zoom. options.encoding: that of the old tiles. Among equals new imagery lies on
// top. Old tiles are hashed when they are read; a damaged one counts as missing and gives a finding.
UpdatedTileSet update_tile_set(const Mission& mission, OldTileSet old_tiles, std::vector<ImageryInput> rasters,
                               const TileRange& range, const TileSetOptions& options, const std::filesystem::path& file,
                               Progress& progress);

}  // namespace nadir
