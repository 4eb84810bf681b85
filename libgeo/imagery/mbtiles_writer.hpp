// Writes a tile set as an MBTiles file (1.3). The file is a plain function of the calls: the same tiles in the same
// order give the same bytes (fixed page size, one transaction, no times, no names).
//
// There is no journal while it is written: a killed writer leaves rubbish, so it belongs into a StagingDirectory.
#pragma once

#include <filesystem>
#include <map>
#include <optional>
#include <string>

#include "geodesy/tile_key.hpp"
#include "imagery/sqlite_database.hpp"

namespace nadir {

class MbtilesWriter {
 public:
  explicit MbtilesWriter(const std::filesystem::path& path);  // throws Error when the file exists

  MbtilesWriter(const MbtilesWriter&) = delete;
  MbtilesWriter& operator=(const MbtilesWriter&) = delete;

  void add(const TileKey& key, ByteView encoded);  // any order; one after the other
  void set_metadata(const std::map<std::string, std::string>& metadata);
  const SqliteDatabase& database() const { return database_; }  // for tables beyond the specification

  // Builds the index (throws Error when a tile was added twice), reads all tiles once more for agg_tiles_hash, commits
  // and closes. Without it the file is useless.
  void finish();

 private:
  // What `mbtiles validate` of the MapLibre project asks for: MD5 over zoom, column and row as decimal text and the
  // tile's bytes, in this order.
  std::string aggregate_hash() const;

  SqliteDatabase database_;
  std::optional<SqliteStatement> insert_;
};

}  // namespace nadir
