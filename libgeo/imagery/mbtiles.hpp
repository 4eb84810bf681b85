// Tile sets in MBTiles files (github.com/mapbox/mbtiles-spec, 1.3): SQLite databases whose tile rows count from the
// south (TMS). Readers open the file read-only and immutable: nobody writes to what an aircraft flies with, and SQLite
// looks for no journal beside it.
#pragma once

#include <filesystem>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "geodesy/web_mercator.hpp"
#include "imagery/sqlite_database.hpp"
#include "imagery/tile_source.hpp"

namespace nadir {

class MbtilesReader final : public TileSource {
 public:
  // Throws Error when the file is missing, is no SQLite database, lacks the tables of the specification, or is empty.
  explicit MbtilesReader(const std::filesystem::path& path);
  explicit MbtilesReader(InputFile file, SqliteSchema schema);

  ZoomRange zooms() const override { return zooms_; }  // of the existing tiles, not as the metadata claims
  std::optional<Bytes> read(const TileKey& key) const override;
  std::optional<Bytes> read_mask(const TileKey& key) const override;  // from nadir_sidecars; other files have none

  std::map<std::string, std::string> metadata() const;
  const SqliteDatabase& database() const { return *database_; }  // for tables beyond the specification

 private:
  std::optional<Bytes> blob(std::optional<SqliteStatement>& statement, const TileKey& key) const;

  std::unique_ptr<SqliteDatabase> database_;  // on the heap: statements point to it
  ZoomRange zooms_;
  mutable std::mutex mutex_;  // statements are shared between threads
  mutable std::optional<SqliteStatement> tile_;
  mutable std::optional<SqliteStatement> mask_;
};

// The file is a function of the calls alone: the same tiles in the same order give the same bytes (one transaction, no
// times, no names). Its pages have 64 KiB where the first thousand tiles take less than 8 MB, and 4 KiB for fewer or
// larger tiles: with 4 KiB, a page that holds a tile of 3 kB has no room for another. There is no journal while it is
// written: a killed writer leaves a damaged file, so write into a StagingDirectory.
class MbtilesWriter {
 public:
  explicit MbtilesWriter(const std::filesystem::path& path);  // throws Error when the file exists

  MbtilesWriter(const MbtilesWriter&) = delete;
  MbtilesWriter& operator=(const MbtilesWriter&) = delete;

  void add(const TileKey& key, ByteView encoded);  // any order; one after the other
  void set_metadata(const std::map<std::string, std::string>& metadata);
  const SqliteDatabase& database();  // for tables beyond the specification, after all tiles

  // Builds the index (throws Error when a tile was added twice), reads all tiles once more for agg_tiles_hash, commits
  // and closes. Without it the file is useless.
  void finish();

 private:
  // As `mbtiles validate` of the MapLibre project expects it: MD5 over zoom, column and row as decimal text and the
  // tile's bytes, in this order.
  std::string aggregate_hash() const;
  void begin(int page_bytes);
  void insert(const TileKey& key, ByteView encoded);

  SqliteDatabase database_;
  std::optional<SqliteStatement> insert_;  // none until the size of the pages is known
  std::vector<std::pair<TileKey, Bytes>> first_;
  std::size_t first_bytes_ = 0;
};

}  // namespace nadir
