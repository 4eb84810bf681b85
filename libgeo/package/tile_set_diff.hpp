// What differs between two tile sets, MBTiles or COG: tiles by address and by the digest of their bytes, what is known
// about them (sidecars), and the metadata. Both files are walked once, side by side, in the order of TileKey.
#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "base/digest.hpp"
#include "base/progress.hpp"
#include "geodesy/web_mercator.hpp"

namespace nadir {

struct TileChange {
  TileKey key;
  std::optional<Sha256> before;  // of the tile's bytes; absent: the tile was added
  std::optional<Sha256> after;   // absent: it was removed
};

// An entry that has another value, or is in one of the two only.
struct EntryChange {
  std::string name;
  std::optional<std::string> before;
  std::optional<std::string> after;
};
using Entries = std::map<std::string, std::string>;
std::vector<EntryChange> diff_entries(const Entries& before, const Entries& after);

struct TileSetDiff {
  std::vector<TileChange> added, removed, changed;  // in the order of TileKey
  std::vector<TileKey> redescribed;                 // the same bytes, but another date, accuracy, source, mask …
  std::vector<EntryChange> metadata;
  std::uint64_t same = 0;  // tiles with the same bytes in both

  bool empty() const {
    return added.empty() && removed.empty() && changed.empty() && redescribed.empty() && metadata.empty();
  }
};

// Throws Error when one of them is no tile set, cannot be read, or holds rows that are no tiles of the grid.
TileSetDiff diff_tile_sets(const std::filesystem::path& before, const std::filesystem::path& after, Progress& progress);

}  // namespace nadir
