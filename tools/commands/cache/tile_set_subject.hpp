// What commands take as PACKAGE|FILE: a package's folder or a bare tile set, MBTiles or COG.
#pragma once

#include <filesystem>
#include <optional>

#include "package/manifest.hpp"

namespace nadir {

struct TileSetSubject {
  std::filesystem::path tiles;
  std::optional<Manifest> manifest;  // of a package; read, not verified
  std::filesystem::path mission;     // of a package, else empty
};

// Throws UsageError when there is nothing of this name, Error when a folder is no package with a tile set.
TileSetSubject find_tile_set(const std::filesystem::path& path);

}  // namespace nadir
