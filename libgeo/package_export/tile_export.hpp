// The imagery of a package in the files of other programs, so that an operator sees the very map that the aircraft
// flies with. Tiles leave bit for bit: nothing is decoded or compressed again.
//
// The package is verified first, all of it. Each tile is compared with its signed digest when it is read; when the
// output is complete, all of it is read back and compared once more. It appears under its name then and not before; a
// process that is killed leaves a hidden folder, which the next one removes. docs/commands/cache-export.md says which
// program reads what.
//
// Masks are not exported: where a tile does not show ground (sidecars.valid_ppm), others see the colours that fill it.
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string_view>

#include "base/error.hpp"
#include "base/progress.hpp"
#include "base/time.hpp"
#include "trust/root.hpp"

namespace nadir {

enum class TileExportFormat {
  pmtiles,          // PMTiles 3: imagery/pmtiles.hpp
  gpkg,             // OGC GeoPackage 1.3, tile matrix set of the web map, rows from the north
  mbtiles,          // MBTiles 1.3 without sidecars
  xyz,              // Z/X/Y.jpg, .png or .webp, and tiles.json (TileJSON 3.0)
  mission_planner,  // its tile cache: TileDBv3/en/Custom/Z/Y/X.jpg, whatever the image is
};
std::string_view name_of(TileExportFormat format);  // "mission-planner"
std::optional<TileExportFormat> parse_tile_export_format(std::string_view name);

struct TileExportRequest {
  std::filesystem::path package, out;
  TileExportFormat format = TileExportFormat::pmtiles;
  const TrustRoot* root = nullptr;
  UtcTime at;  // the package is judged as of then
};

struct ExportedTiles {
  Findings findings;  // refuse: nothing was written
  std::uint64_t tiles = 0;
  std::uint64_t contents = 0;  // different ones among them, where the format stores each once
  std::uint64_t bytes = 0;     // of the output
};

// Throws UsageError when the output exists or the format cannot hold these images, Error for what cannot be read or
// written, OutOfSpace.
ExportedTiles export_tiles(const TileExportRequest& request, Progress& progress);

}  // namespace nadir
