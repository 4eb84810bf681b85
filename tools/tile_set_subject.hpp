// What commands take as PACKAGE|FILE.mbtiles: a package's folder or a bare tile set.
#pragma once

#include <filesystem>
#include <optional>

#include "package/manifest.hpp"

namespace nadir {

struct TileSetSubject {
  std::filesystem::path mbtiles;
  std::optional<Manifest> manifest;  // of a package; read, not verified
  std::filesystem::path mission;     // of a package, else empty
};

// Throws UsageError when there is nothing of this name, Error when a folder is no package with tiles in MBTiles.
TileSetSubject find_tile_set(const std::filesystem::path& path);

}  // namespace nadir
