#include "package/tile_container.hpp"

#include <algorithm>
#include <array>
#include <exception>
#include <nlohmann/json.hpp>
#include <utility>

#include "base/json.hpp"
#include "imagery/cog_reader.hpp"
#include "imagery/mbtiles.hpp"
#include "imagery/pmtiles.hpp"
#include "package/manifest.hpp"
#include "package/sidecar.hpp"

namespace nadir {
namespace {

constexpr const char* kSelectTileKeys = R"sql(
SELECT zoom_level, tile_column, tile_row FROM tiles ORDER BY zoom_level, tile_column, tile_row DESC
)sql";

constexpr const char* kSelectTiles = R"sql(
SELECT zoom_level, tile_column, tile_row, tile_data FROM tiles
ORDER BY zoom_level, tile_column, tile_row DESC
)sql";

// The same in two steps: the order is not that of the usual index, and SQLite would write all tiles to a temporary file
// to sort them.
constexpr const char* kSelectTileRows = R"sql(
SELECT zoom_level, tile_column, tile_row, rowid FROM tiles ORDER BY zoom_level, tile_column, tile_row DESC
)sql";
constexpr const char* kSelectTileOfRow = "SELECT tile_data FROM tiles WHERE rowid = ?";
constexpr const char* kTilesHaveRows =
    "SELECT 1 FROM sqlite_schema WHERE name = 'tiles' AND type = 'table' AND sql NOT LIKE '%WITHOUT%ROWID%'";

// The table "metadata" of a database, empty without one.
std::map<std::string, std::string> metadata_in(const SqliteDatabase& database) {
  std::map<std::string, std::string> entries;
  if (!database.has_table("metadata")) return entries;
  auto rows = database.prepare("SELECT name, value FROM metadata ORDER BY name, value");
  while (rows.step()) entries[std::string(rows.text(0))] = std::string(rows.text(1));
  return entries;
}

class MbtilesCursor : public TileCursor {
 public:
  MbtilesCursor(const SqliteDatabase& database, const char* select) : rows_(database.prepare(select)) {}

  bool next() override { return rows_.step(); }
  std::optional<TileKey> key() const override { return row_key(rows_); }
  std::string address() const override { return row_address_text(rows_); }
  ByteView bytes() override { return rows_.blob(3); }
  std::optional<Bytes> mask() override { return std::nullopt; }

 protected:
  SqliteStatement rows_;
};

// Addresses first, each tile on demand.
class MbtilesRowidCursor final : public MbtilesCursor {
 public:
  explicit MbtilesRowidCursor(const SqliteDatabase& database)
      : MbtilesCursor(database, kSelectTileRows), tile_(database.prepare(kSelectTileOfRow)) {}

  bool next() override {
    fetched_ = false;
    return MbtilesCursor::next();
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
  MbtilesContainer(InputFile file, SqliteSchema schema)
      : database_(SqliteDatabase::open_immutable(std::move(file), schema)) {}

  std::string_view kind() const override { return "mbtiles"; }

  std::unique_ptr<TileCursor> tiles(bool with_bytes) const override {
    if (!with_bytes) return std::make_unique<MbtilesCursor>(database_, kSelectTileKeys);
    if (database_.prepare(kTilesHaveRows).step()) return std::make_unique<MbtilesRowidCursor>(database_);
    return std::make_unique<MbtilesCursor>(database_, kSelectTiles);
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

std::unique_ptr<TileContainer> open_mbtiles_container(InputFile file, SqliteSchema schema) {
  const std::filesystem::path path = file.path();
  auto container = std::make_unique<MbtilesContainer>(std::move(file), schema);
  bool missing = false;
  try {
    missing = !container->has_tiles();
  } catch (const Error&) {  // damaged: shows when it is walked
  }
  if (!missing) return container;
  throw Error({.what = "not an MBTiles file: table \"tiles\" is missing",
               .where = path,
               .expected = "an MBTiles file (a database with metadata and tiles)",
               .fix = "give a raster tile set in MBTiles 1.3, or a COG"});
}

void add_to_summary(const TileKey& key, std::uint64_t bytes, std::vector<ZoomSummary>& zooms) {
  const std::int64_t x = key.x, y = key.tms_row();
  if (zooms.empty() || zooms.back().zoom != key.z) zooms.push_back({key.z, 0, 0, x, x, y, y});
  ZoomSummary& zoom = zooms.back();
  ++zoom.tiles;
  zoom.bytes += static_cast<std::int64_t>(bytes);
  zoom.first_column = std::min(zoom.first_column, x), zoom.last_column = std::max(zoom.last_column, x);
  zoom.first_tms_row = std::min(zoom.first_tms_row, y), zoom.last_tms_row = std::max(zoom.last_tms_row, y);
}

// Tiles that are cut out of decoded blocks are absent when nothing of them is shown: that needs their pixels.
class CogCursor final : public TileCursor {
 public:
  CogCursor(const CogReader& reader, bool with_bytes)
      : reader_(reader), keys_(reader.keys()), with_bytes_(with_bytes) {}

  bool next() override {
    bytes_.reset();
    failure_ = nullptr;
    while (next_ < keys_.size()) {
      key_ = keys_[next_++];
      if (!with_bytes_) return true;
      try {
        bytes_ = reader_.read(key_);
        if (bytes_) return true;
      } catch (const Error&) {
        failure_ = std::current_exception();
        return true;
      }
    }
    return false;
  }

  std::optional<TileKey> key() const override { return key_; }
  std::string address() const override { return "tile " + to_text(key_); }
  ByteView bytes() override {
    if (failure_) std::rethrow_exception(failure_);
    return bytes_ ? ByteView(*bytes_) : ByteView();
  }
  std::optional<Bytes> mask() override { return reader_.read_mask(key_); }

 private:
  const CogReader& reader_;
  std::vector<TileKey> keys_;
  bool with_bytes_;
  std::size_t next_ = 0;
  TileKey key_;
  std::optional<Bytes> bytes_;
  std::exception_ptr failure_;
};

class CogContainer final : public TileContainer {
 public:
  CogContainer(TileSetFiles files, const TileSetRules& rules)
      : path_(files.tiles.path()), reader_(std::move(files.tiles), rules.cog) {
    if (!files.sidecars) return;
    sidecars_.emplace(SqliteDatabase::open_immutable(std::move(*files.sidecars), rules.schema));
  }

  std::string_view kind() const override { return "cog"; }
  std::unique_ptr<TileCursor> tiles(bool with_bytes) const override {
    return std::make_unique<CogCursor>(reader_, with_bytes);
  }
  std::uint64_t count() const override { return reader_.keys().size(); }

  std::vector<ZoomSummary> summary() const override {
    std::vector<ZoomSummary> zooms;
    for (const TileKey& key : reader_.keys()) add_to_summary(key, reader_.stored_size(key), zooms);
    return zooms;
  }

  std::map<std::string, std::string> metadata() const override {
    return sidecars_ ? metadata_in(*sidecars_) : std::map<std::string, std::string>();
  }
  const SqliteDatabase* sidecars() const override {
    return sidecars_ && has_sidecars(*sidecars_) ? &*sidecars_ : nullptr;
  }

  Findings remarks() const override {
    Findings findings;
    for (const std::string& overview : reader_.left_out()) {
      findings.add({.code = "tiff.grid",
                    .severity = Severity::warning,
                    .where = path_.filename().string() + ", overview of " + overview,
                    .expected = "pixels aligned with a zoom of the web map",
                    .found = "misaligned pixels: the overview is not used",
                    .fix = "gdal_translate -of COG -co TILING_SCHEME=GoogleMapsCompatible -co ALIGNED_LEVELS=N, N the "
                           "number of zooms"});
    }
    return findings;
  }

 private:
  std::filesystem::path path_;
  CogReader reader_;
  std::optional<SqliteDatabase> sidecars_;
};

class PmtilesCursor final : public TileCursor {
 public:
  PmtilesCursor(const PmtilesReader& reader, std::vector<TileKey> keys) : reader_(reader), keys_(std::move(keys)) {}

  bool next() override {
    if (next_ == keys_.size()) return false;
    key_ = keys_[next_++];
    bytes_.reset();
    return true;
  }
  std::optional<TileKey> key() const override { return key_; }
  std::string address() const override { return "tile " + to_text(key_); }
  ByteView bytes() override {
    if (!bytes_) bytes_ = reader_.read(key_);
    return bytes_ ? ByteView(*bytes_) : ByteView();
  }
  std::optional<Bytes> mask() override { return std::nullopt; }

 private:
  const PmtilesReader& reader_;
  std::vector<TileKey> keys_;
  std::size_t next_ = 0;
  TileKey key_;
  std::optional<Bytes> bytes_;
};

class PmtilesContainer final : public TileContainer {
 public:
  explicit PmtilesContainer(InputFile file) : reader_(std::move(file)) {}

  std::string_view kind() const override { return "pmtiles"; }
  std::unique_ptr<TileCursor> tiles(bool /*with_bytes*/) const override {
    return std::make_unique<PmtilesCursor>(reader_, reader_.keys());
  }
  std::uint64_t count() const override { return reader_.keys().size(); }

  std::vector<ZoomSummary> summary() const override {
    std::vector<ZoomSummary> zooms;
    for (const TileKey& key : reader_.keys()) {
      add_to_summary(key, reader_.stored_size(key).value_or(0), zooms);
    }
    return zooms;
  }

  // As MBTiles names it; what the JSON says beyond texts is left out.
  std::map<std::string, std::string> metadata() const override {
    std::map<std::string, std::string> entries;
    if (reader_.metadata().empty()) return entries;
    const nlohmann::json document = parse_json(reader_.metadata(), "the file's metadata");
    for (const auto& [name, value] : document.items()) {
      if (value.is_string()) entries[name] = value.get<std::string>();
    }
    return entries;
  }
  const SqliteDatabase* sidecars() const override { return nullptr; }

 private:
  PmtilesReader reader_;
};

bool begins_as_pmtiles(const InputFile& file) {
  std::array<std::uint8_t, kPmtilesMagic.size()> head{};
  return file.read_at(0, head) && as_text(head) == kPmtilesMagic;
}

bool begins_as_tiff(const InputFile& file) {
  std::array<std::uint8_t, 4> head{};
  const bool whole = file.read_at(0, head);
  const std::string_view magic = whole ? as_text(head) : std::string_view();
  return magic == std::string_view("II*\0", 4) || magic == std::string_view("MM\0*", 4) ||
         magic == std::string_view("II+\0", 4) || magic == std::string_view("MM\0+", 4) ||
         (file.path().extension() == ".tif" && magic != "SQLi");
}

}  // namespace

TileSetFiles open_tile_set_files(const std::filesystem::path& path) {
  TileSetFiles files{InputFile(path), std::nullopt};
  const std::filesystem::path beside = path.parent_path() / std::filesystem::path(kSidecarFile).filename();
  if (begins_as_tiff(files.tiles) && std::filesystem::exists(beside)) files.sidecars.emplace(beside);
  return files;
}

std::unique_ptr<TileContainer> open_tile_container(TileSetFiles files, const TileSetRules& rules) {
  if (begins_as_tiff(files.tiles)) return std::make_unique<CogContainer>(std::move(files), rules);
  if (rules.pmtiles && begins_as_pmtiles(files.tiles)) {
    return std::make_unique<PmtilesContainer>(std::move(files.tiles));
  }
  return open_mbtiles_container(std::move(files.tiles), rules.schema);
}

std::unique_ptr<TileContainer> open_tile_container(const std::filesystem::path& path) {
  return open_tile_container(open_tile_set_files(path), {});
}

std::unique_ptr<TileSource> open_tile_source(InputFile tiles, const TileSetRules& rules) {
  if (begins_as_tiff(tiles)) return std::make_unique<CogReader>(std::move(tiles), rules.cog);
  if (rules.pmtiles && begins_as_pmtiles(tiles)) return std::make_unique<PmtilesReader>(std::move(tiles));
  return std::make_unique<MbtilesReader>(std::move(tiles), rules.schema);
}

std::unique_ptr<TileSource> open_tile_source(const std::filesystem::path& path) {
  return open_tile_source(InputFile(path), {});
}

Finding tile_set_finding(const Error& error, std::string where) {
  const ErrorText& text = error.text();
  if (const auto* cog = dynamic_cast<const TiffError*>(&error)) {
    return {.code = cog->code(),
            .where = std::move(where),
            .expected = text.expected,
            .found = text.found.empty() ? text.what : text.found,
            .fix = text.fix};
  }
  return {.code = "sqlite.corrupt",
          .where = std::move(where),
          .expected = "an intact SQLite database",
          .found = text.found.empty() ? text.what : text.found,
          .fix = "create the file again; copying a damaged file does not repair it"};
}

}  // namespace nadir
