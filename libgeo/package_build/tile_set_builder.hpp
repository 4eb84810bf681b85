// Imagery to a tile set: an MBTiles file or a COG with overviews and sidecars.
//
// The work has two halves. make_metatiles() warps, averages and encodes metatiles by several threads and keeps them in
// a journal; TileSetAssembler takes them in their one order, makes the overviews above them and writes the file. So the
// file is the same for any number of threads, and for any number of machines that made metatiles. Memory is bounded:
// overviews are assembled as soon as their children are done.
#pragma once

#include <filesystem>
#include <functional>
#include <map>
#include <optional>
#include <span>
#include <string_view>
#include <vector>

#include "base/progress.hpp"
#include "imagery/cog_writer.hpp"
#include "imagery/mbtiles.hpp"
#include "package/manifest.hpp"
#include "package_build/build_journal.hpp"
#include "package_build/build_plan.hpp"
#include "package_build/metatile.hpp"

namespace nadir {

enum class TileSetKind { mbtiles, cog };

std::string_view file_of(TileSetKind kind);  // its name inside a package

struct TileSetOptions {
  TileSetKind container = TileSetKind::mbtiles;
  TileEncoding encoding;
  MosaicOptions mosaic;
  int threads = 1;
};

struct TileSet {
  std::vector<Sidecar> sidecars;  // in the order of TileKey
  TileSetFacts facts;
  std::uint64_t tile_bytes = 0;
  std::uint64_t resumed = 0;                      // tiles of the finest zoom that the journal held
  bool over_budget = false;                       // aborted: the tiles alone exceed the mission's budget
  std::optional<std::uint64_t> expected_bytes{};  // over budget: of all tiles, as large as those that were made
};

// The tiles of a build: what they are made of, and the metatiles that the work is split into.
struct TilePlan {
  TilePlan(const Mission& mission, std::span<const ImageryInput> inputs, const TileRange& range,
           const TileSetOptions& options);

  std::uint64_t finest_tiles(std::size_t first, std::size_t last) const;  // of metatiles [first, last), at most

  const Mission& mission;
  std::span<const ImageryInput> inputs;  // the topmost first
  TileRange range;                       // of the finest zoom
  TileSetOptions options;
  std::vector<TileKey> metatiles;  // metatiles_of(mission, range)
};

// A part of a plan's metatiles: [first, last).
struct MetatileSpan {
  std::size_t first = 0, last = 0;

  std::size_t count() const { return last - first; }
  bool operator==(const MetatileSpan&) const = default;
};

// Makes these metatiles. Those that the journal holds are taken from there; the others are appended to it before they
// are handed on. take: gets them in their order and ends the work by false. Advances progress by tiles of the finest
// zoom. Returns how many of these were taken from the journal.
using TakeMetatile = std::function<bool(Metatile)>;
std::uint64_t make_metatiles(const TilePlan& plan, MetatileSpan part, BuildJournal& journal, const TakeMetatile& take,
                             Progress& progress);

// Both halves on one machine.
TileSet build_tile_set(const TilePlan& plan, const std::filesystem::path& file, BuildJournal& journal,
                       Progress& progress);

// Writes tiles in any order to an MBTiles file with sidecars inside, or to a COG with sidecars.sqlite beside it. Counts
// the bytes against the mission's budget.
class TileSetWriter {
 public:
  // format, range: as for finish(); a COG needs them at the start. Throws UsageError when a COG cannot hold the zooms.
  TileSetWriter(TileSetKind kind, std::filesystem::path file, const Mission& mission, const TileRange& range,
                ImageFormat format);

  void add(EncodedTile tile);
  bool over_budget() const { return set_.over_budget; }

  // Writes sidecars and metadata and closes the file; over budget it only returns. range: of the finest zoom.
  TileSet finish(const TileRange& range, ImageFormat format);

 private:
  const Mission& mission_;
  std::filesystem::path file_;
  std::optional<MbtilesWriter> mbtiles_;  // one of the two
  std::optional<CogWriter> cog_;
  TileSet set_;
};

// Makes the overviews above the metatiles. Tiles arrive in Morton order, so that parents are complete soon: only a few
// images per zoom wait in memory, however large the area is.
class OverviewAssembler {
 public:
  // Receives every overview with a valid pixel.
  using OverviewSink = std::function<void(const TileKey& key, const TileCanvas& overview)>;

  // tops: every metatile that will be added. Parents down to min_zoom are made.
  OverviewAssembler(const std::vector<TileKey>& tops, int min_zoom, OverviewSink sink);

  void add(const TileKey& key, const TileCanvas& tile);

 private:
  struct Parent {
    MaskedImage image;  // twice kTileSize
    InputShares used;
    int missing = 0;
  };
  int min_zoom_;
  OverviewSink sink_;
  std::map<TileKey, int> children_;  // number of children of each parent
  std::map<TileKey, Parent> parents_;
};

// All metatiles of a plan, one after the other in their order, to the tile set's file.
class TileSetAssembler {
 public:
  TileSetAssembler(const TilePlan& plan, const std::filesystem::path& file);

  bool add(Metatile metatile);  // false: over budget, and nothing more is wanted

  // After all metatiles, or over budget.
  TileSet finish();

 private:
  const TilePlan& plan_;
  TileEncoder encoder_;
  TileSetWriter writer_;
  OverviewAssembler overviews_;
  std::size_t taken_ = 0;
};

}  // namespace nadir
