// Where the tiles of a new package go, in whatever order they are made: an MBTiles file with sidecars. Counts the bytes
// against the mission's budget.
#pragma once

#include <filesystem>
#include <vector>

#include "ground/metatile.hpp"
#include "imagery/mbtiles_writer.hpp"
#include "package/manifest.hpp"

namespace nadir {

struct TileSet {
  std::vector<Sidecar> sidecars;  // in the order of TileKey
  TileSetFacts facts;
  std::uint64_t tile_bytes = 0;
  std::uint64_t resumed = 0;  // tiles of the finest zoom that the journal held
  bool over_budget = false;   // given up: the tiles alone are larger than the mission's budget
};

class TileSetWriter {
 public:
  TileSetWriter(const std::filesystem::path& mbtiles, const Mission& mission);

  void add(EncodedTile tile);
  bool over_budget() const { return set_.over_budget; }

  // Writes what follows from all tiles and closes; over budget the file stays without it. range: of the finest zoom.
  TileSet finish(const TileRange& range, ImageFormat format);

 private:
  const Mission& mission_;
  MbtilesWriter writer_;
  TileSet set_;
};

}  // namespace nadir
