// A tile set in a file: MBTiles or COG, which packages have, or PMTiles of others. Code that checks, compares and
// displays tile sets iterates over them with TileContainer; the aircraft reads single tiles through TileSource.
//
// Sidecars and metadata are in the MBTiles file itself; those of a COG are in sidecars.sqlite in the same folder.
#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "base/error.hpp"
#include "base/input_file.hpp"
#include "imagery/cog_reader.hpp"
#include "imagery/sqlite_database.hpp"
#include "imagery/tiff.hpp"
#include "imagery/tile_source.hpp"

namespace nadir {

// One tile after the other, in the order of TileKey as far as the file's rows allow it.
class TileCursor {
 public:
  virtual ~TileCursor() = default;
  virtual bool next() = 0;                         // before the first as well; false at the end
  virtual std::optional<TileKey> key() const = 0;  // nullopt: an address outside of the grid
  virtual std::string address() const = 0;         // as the file has it, for messages
  virtual ByteView bytes() = 0;                    // until next(); throws Error when they cannot be had
  virtual std::optional<Bytes> mask() = 0;         // the container's own validity mask
};

struct ZoomSummary {
  std::int64_t zoom = 0, tiles = 0, bytes = 0;
  std::int64_t first_column = 0, last_column = 0, first_tms_row = 0, last_tms_row = 0;
};

class TileContainer {
 public:
  virtual ~TileContainer() = default;
  virtual std::string_view kind() const = 0;  // "mbtiles", "cog", "pmtiles"
  virtual std::unique_ptr<TileCursor> tiles(bool with_bytes) const = 0;
  virtual std::uint64_t count() const = 0;  // upper limit of what the cursor visits
  virtual std::vector<ZoomSummary> summary() const = 0;
  virtual std::map<std::string, std::string> metadata() const = 0;
  virtual const SqliteDatabase* sidecars() const = 0;                 // null: there are none
  virtual const SqliteDatabase* database() const { return nullptr; }  // of an MBTiles file: its rows
  virtual Findings remarks() const { return {}; }                     // about parts of the file that are not used
};

// A tile set's files, opened: what is examined and what is read afterwards are the same bytes.
struct TileSetFiles {
  InputFile tiles;
  std::optional<InputFile> sidecars;  // beside a COG
};
// Symbolic links are followed. Throws Error when there is no such file.
TileSetFiles open_tile_set_files(const std::filesystem::path& tiles);

// Where a tile set comes from, and so what it may be.
struct TileSetRules {
  SqliteSchema schema = SqliteSchema::any;  // other programs keep tiles in views
  CogLimits cog{};
  bool pmtiles = true;

  // A package's, whose manifest states so many tiles.
  static TileSetRules of_package(std::uint64_t tiles) {
    return {SqliteSchema::plain, CogLimits::for_tiles(tiles), false};
  }
};

// By the file's first bytes. Throws TiffError for a TIFF that is no tile set, Error for a file that is neither, that is
// no database, or that has no table "tiles". Damage further inside the database shows during iteration.
std::unique_ptr<TileContainer> open_tile_container(const std::filesystem::path& path);
std::unique_ptr<TileContainer> open_tile_container(TileSetFiles files, const TileSetRules& rules);

// For reading single tiles; stricter: an MBTiles file must have what the specification requires.
std::unique_ptr<TileSource> open_tile_source(const std::filesystem::path& path);
std::unique_ptr<TileSource> open_tile_source(InputFile tiles, const TileSetRules& rules);

// An error while reading a tile set as a finding: "sqlite.corrupt", "tiff.corrupt", "tiff.grid", "tiff.layout".
Finding tile_set_finding(const Error& error, std::string where);

}  // namespace nadir
