// Imagery to an MBTiles file or a COG with overviews and sidecars.
//
// Metatiles are warped, averaged and encoded by several threads and written in one order; the file is the same for any
// number of threads.
#pragma once

#include <filesystem>
#include <span>
#include <vector>

#include "base/progress.hpp"
#include "package_build/build_journal.hpp"
#include "package_build/metatile.hpp"
#include "package_build/tile_set_writer.hpp"

namespace nadir {

struct TileSetOptions {
  TileSetKind container = TileSetKind::mbtiles;
  TileEncoding encoding;
  MosaicOptions mosaic;
  int threads = 1;
};

// Metatiles that the journal holds are taken from there; the others go into it before anything else is done with them.
TileSet build_tile_set(const Mission& mission, std::span<const ImageryInput> inputs, const TileRange& range,
                       const TileSetOptions& options, const std::filesystem::path& file, BuildJournal& journal,
                       Progress& progress);

}  // namespace nadir
