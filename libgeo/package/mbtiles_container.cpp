#include "package/mbtiles_container.hpp"

#include "package/sidecar_sql.hpp"
#include "package/sidecar_table.hpp"

namespace nadir {
namespace {

class Rows : public TileCursor {
 public:
  Rows(const SqliteDatabase& database, const char* select) : rows_(database.prepare(select)) {}

  bool next() override { return rows_.step(); }
  std::optional<TileKey> key() const override { return row_key(rows_); }
  std::string address() const override { return row_address_text(rows_); }
  ByteView bytes() override { return rows_.blob(3); }
  std::optional<Bytes> mask() override { return std::nullopt; }

 protected:
  SqliteStatement rows_;
};

// Addresses first, each tile when it is asked for.
class RowsByNumber final : public Rows {
 public:
  explicit RowsByNumber(const SqliteDatabase& database)
      : Rows(database, sql::kSelectTileRows), tile_(database.prepare(sql::kSelectTileOfRow)) {}

  bool next() override {
    fetched_ = false;
    return Rows::next();
  }
  ByteView bytes() override {
    if (!fetched_) {
      tile_.reset();
      tile_.bind(1, rows_.integer(3));
      there_ = tile_.step();
      fetched_ = true;
    }
    return there_ ? tile_.blob(0) : ByteView{};
  }

 private:
  SqliteStatement tile_;
  bool fetched_ = false, there_ = false;
};

class MbtilesContainer final : public TileContainer {
 public:
  explicit MbtilesContainer(const std::filesystem::path& path) : database_(SqliteDatabase::open_immutable(path)) {}

  std::string_view kind() const override { return "mbtiles"; }

  std::unique_ptr<TileCursor> tiles(bool with_bytes) const override {
    if (!with_bytes) return std::make_unique<Rows>(database_, sql::kSelectTileKeys);
    if (database_.prepare(sql::kTilesHaveRows).step()) return std::make_unique<RowsByNumber>(database_);
    return std::make_unique<Rows>(database_, sql::kSelectTiles);
  }

  std::uint64_t count() const override {
    auto row = database_.prepare("SELECT count(*) FROM tiles");
    return row.step() ? static_cast<std::uint64_t>(row.integer(0)) : 0;
  }

  std::vector<ZoomSummary> summary() const override {
    std::vector<ZoomSummary> zooms;
    auto rows = database_.prepare(
        "SELECT zoom_level, count(*), sum(length(tile_data)), min(tile_column), max(tile_column), min(tile_row),"
        " max(tile_row) FROM tiles GROUP BY zoom_level ORDER BY zoom_level");
    while (rows.step()) {
      zooms.push_back({rows.integer(0), rows.integer(1), rows.integer(2), rows.integer(3), rows.integer(4),
                       rows.integer(5), rows.integer(6)});
    }
    return zooms;
  }

  std::map<std::string, std::string> metadata() const override { return metadata_in(database_); }
  const SqliteDatabase* sidecars() const override { return has_sidecars(database_) ? &database_ : nullptr; }
  const SqliteDatabase* database() const override { return &database_; }
  bool has_tiles() const { return database_.has_table("tiles"); }

 private:
  SqliteDatabase database_;
};

}  // namespace

std::unique_ptr<TileContainer> open_mbtiles_container(const std::filesystem::path& path) {
  auto container = std::make_unique<MbtilesContainer>(path);
  bool missing = false;
  try {
    missing = !container->has_tiles();
  } catch (const Error&) {  // damaged: shows when it is walked
  }
  if (!missing) return container;
  throw Error({.what = "no MBTiles file: the table \"tiles\" is missing",
               .where = path,
               .expected = "an MBTiles file (a database with metadata and tiles)",
               .fix = "name a raster tile set in MBTiles 1.3, or a COG"});
}

std::map<std::string, std::string> metadata_in(const SqliteDatabase& database) {
  std::map<std::string, std::string> entries;
  if (!database.has_table("metadata")) return entries;
  auto rows = database.prepare("SELECT name, value FROM metadata ORDER BY name, value");
  while (rows.step()) entries[std::string(rows.text(0))] = std::string(rows.text(1));
  return entries;
}

}  // namespace nadir
