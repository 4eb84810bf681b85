// Where the tiles of a new package go, in whatever order they are made: an MBTiles file with sidecars inside, or a COG
// with sidecars.sqlite beside it. Counts the bytes against the mission's budget.
#pragma once

#include <filesystem>
#include <optional>
#include <string_view>
#include <vector>

#include "package_build/metatile.hpp"
#include "package_build/tile_plan.hpp"
#include "imagery/cog_writer.hpp"
#include "imagery/mbtiles.hpp"
#include "package/manifest.hpp"

namespace nadir {

enum class TileSetKind { mbtiles, cog };

std::string_view file_of(TileSetKind kind);  // its name inside a package

struct TileSet {
  std::vector<Sidecar> sidecars;  // in the order of TileKey
  TileSetFacts facts;
  std::uint64_t tile_bytes = 0;
  std::uint64_t resumed = 0;  // tiles of the finest zoom that the journal held
  bool over_budget = false;   // given up: the tiles alone are larger than the mission's budget
};

class TileSetWriter {
 public:
  // format, range: as for finish(), which a COG has to know at once. Throws UsageError when a COG cannot hold the
  // zooms.
  TileSetWriter(TileSetKind kind, std::filesystem::path file, const Mission& mission, const TileRange& range,
                ImageFormat format);

  void add(EncodedTile tile);
  bool over_budget() const { return set_.over_budget; }

  // Writes what follows from all tiles and closes; over budget the file stays without it. range: of the finest zoom.
  TileSet finish(const TileRange& range, ImageFormat format);

 private:
  const Mission& mission_;
  std::filesystem::path file_;
  std::optional<MbtilesWriter> mbtiles_;  // one of the two
  std::optional<CogWriter> cog_;
  TileSet set_;
};

}  // namespace nadir
