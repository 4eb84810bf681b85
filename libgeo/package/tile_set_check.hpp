// Checks the imagery of a package, MBTiles or COG: its tiles and sidecars against each other and against the signed
// manifest.
#pragma once

#include <filesystem>
#include <vector>

#include "base/error.hpp"
#include "base/progress.hpp"
#include "package/manifest.hpp"
#include "package/sidecar.hpp"
#include "package/tile_container.hpp"

namespace nadir {

// quick trusts that each tile's bytes have the digest that is stored beside them; full hashes them all.
enum class VerifyDepth { quick, full };

struct TileSetCheck {
  std::vector<Sidecar> sidecars;  // in the order of TileKey
  // sqlite.corrupt tiff.corrupt tiles.count tiles.root tile.misaddressed; full also artifact.hash (of a tile),
  // tile.undecodable, tile.size
  Findings findings;
};

// By the rules of packages (TileSetRules::of_package): a set that holds code or more tiles than were signed is refused
// before it is read.
TileSetCheck check_tile_set(TileSetFiles files, const TileSetFacts& facts, VerifyDepth depth, Progress& progress);

// The facts for a manifest, from a finished tile set. Throws Error when it is not sound.
TileSetFacts tile_set_facts(const std::filesystem::path& tiles);

}  // namespace nadir
