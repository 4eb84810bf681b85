// What an MBTiles file says about itself and how it lies on the disk, apart from its tiles: journals that nobody
// finished, damage inside the database, what the table `metadata` claims, whether reads find tiles without a search.
#pragma once

#include <filesystem>
#include <map>
#include <optional>
#include <set>
#include <string>

#include "base/error.hpp"
#include "geodesy/web_mercator.hpp"
#include "imagery/codecs.hpp"
#include "imagery/sqlite_database.hpp"

namespace nadir {

// What a walk over the tiles saw.
struct SeenTiles {
  std::map<int, TileKey> west, east, north, south;  // by zoom: the outermost tile to each side
  std::set<ImageFormat> formats;

  void add(const TileKey& key, std::optional<ImageFormat> format);
  bool empty() const { return west.empty(); }
};

// "sqlite.journal": a rollback journal or write-ahead log lies beside the file (its last changes are in there, or half
// of them are in the file); a file in WAL mode is a warning, because read-only media cannot serve it to others.
Findings check_journals(const std::filesystem::path& mbtiles);

// "sqlite.corrupt": what SQLite's own integrity_check says, and "tiles.unindexed": a read of one tile searches them
// all. Throws Error when the database cannot be read at all.
Findings check_database(const SqliteDatabase& database);

// "metadata.mismatch": what the file claims (format, zooms, bounds) is not what it holds. Refuses when the table is
// missing, because no reader opens such a file; else a warning, because others show the file at the wrong place or not.
Findings check_metadata(const SqliteDatabase& database, const SeenTiles& seen);

}  // namespace nadir
