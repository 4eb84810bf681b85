#include "package_export/tile_export.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <array>
#include <memory>
#include <nlohmann/json.hpp>
#include <set>
#include <string>
#include <vector>

#include "base/files.hpp"
#include "base/input_file.hpp"
#include "imagery/codecs.hpp"
#include "imagery/mbtiles.hpp"
#include "imagery/pmtiles.hpp"
#include "imagery/sqlite_database.hpp"
#include "package/open_package.hpp"
#include "package/verify.hpp"

namespace nadir {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;

constexpr std::array<std::pair<TileExportFormat, std::string_view>, 5> kNames{
    {{TileExportFormat::pmtiles, "pmtiles"},
     {TileExportFormat::gpkg, "gpkg"},
     {TileExportFormat::mbtiles, "mbtiles"},
     {TileExportFormat::xyz, "xyz"},
     {TileExportFormat::mission_planner, "mission-planner"}}};

// What other programs show beside the tiles.
struct MapFacts {
  std::string name, description, attribution;
  std::int64_t version = 0;
  UtcTime created;
  ImageFormat format = ImageFormat::jpeg;
  ZoomRange zoom;
  LonLatBox bounds;  // of the finest zoom's tiles
};

std::string extension_of(ImageFormat format) {
  return format == ImageFormat::jpeg ? "jpg" : std::string(name_of(format));
}

MapFacts facts_of(const Verification& package) {
  const Manifest& manifest = *package.manifest;
  const Artifact& imagery = *manifest.artifact(kRoleImagery);
  MapFacts facts;
  facts.name = manifest.mission_id;
  facts.description = fmt::format("Imagery of the mission package {}, sequence {}", manifest.series, manifest.sequence);
  facts.version = manifest.sequence;
  facts.created = manifest.created;
  facts.format = parse_image_format(imagery.tiles->format).value_or(ImageFormat::jpeg);
  facts.zoom = imagery.tiles->zoom;
  facts.bounds = {180, 90, -180, -90};
  std::set<std::string> sources;
  for (const Sidecar& tile : package.tiles) {
    sources.insert(tile.source);
    if (tile.key.z != facts.zoom.max) continue;
    const LonLatBox box = bounds_of(tile.key);
    facts.bounds = {std::min(facts.bounds.west_deg, box.west_deg), std::min(facts.bounds.south_deg, box.south_deg),
                    std::max(facts.bounds.east_deg, box.east_deg), std::max(facts.bounds.north_deg, box.north_deg)};
  }
  for (const SourceLicence& source : imagery.tiles->sources) {
    sources.erase(source.source);
    sources.insert(fmt::format("{} ({})", source.attribution.empty() ? source.source : source.attribution,
                               source.licence == kUnknownLicence ? "licence unknown" : source.licence));
  }
  facts.attribution = fmt::format("{}", fmt::join(sources, ", "));
  return facts;
}

// Writes all tiles, each read once, and then reads single ones back.
class TileFile {
 public:
  using ReadTile = std::function<Bytes(const TileKey&)>;
  virtual ~TileFile() = default;
  virtual std::uint64_t write(const std::vector<Sidecar>& tiles, const ReadTile& read, Progress& progress) = 0;
  virtual std::optional<Bytes> read_back(const TileKey& key) = 0;
};

class PmtilesFile final : public TileFile {
 public:
  PmtilesFile(fs::path path, const MapFacts& facts) : path_(std::move(path)), facts_(facts) {}

  // Where a tile's bytes lie follows from the sizes of all of them: the tile set is read twice.
  std::uint64_t write(const std::vector<Sidecar>& tiles, const ReadTile& read, Progress& progress) override {
    std::vector<PmtilesTile> sizes;
    sizes.reserve(tiles.size());
    progress.begin("measuring", tiles.size(), "tiles");
    for (const Sidecar& tile : tiles) {
      sizes.push_back({tile.key, tile.sha256, static_cast<std::uint32_t>(read(tile.key).size())});
      progress.advance();
    }
    progress.end();
    const json metadata{{"name", facts_.name},
                        {"description", facts_.description},
                        {"attribution", facts_.attribution},
                        {"type", "baselayer"},
                        {"version", std::to_string(facts_.version)}};
    progress.begin("exporting", tiles.size(), "tiles");
    const PmtilesCounts counts = write_pmtiles(path_, std::move(sizes), {facts_.format, facts_.bounds, metadata.dump()},
                                               read, [&progress] { progress.advance(); });
    progress.end();
    return counts.contents;
  }
  std::optional<Bytes> read_back(const TileKey& key) override {
    if (!reader_) reader_.emplace(InputFile(path_));
    return reader_->read(key);
  }

 private:
  fs::path path_;
  const MapFacts& facts_;
  std::optional<PmtilesReader> reader_;
};

// Of those that take one tile after the other.
class TileByTile : public TileFile {
 public:
  std::uint64_t write(const std::vector<Sidecar>& tiles, const ReadTile& read, Progress& progress) final {
    progress.begin("exporting", tiles.size(), "tiles");
    for (const Sidecar& tile : tiles) {
      add(tile.key, read(tile.key));
      progress.advance();
    }
    progress.end();
    finish();
    return tiles.size();
  }

 protected:
  virtual void add(const TileKey& key, ByteView bytes) = 0;
  virtual void finish() {}
};

class MbtilesFile final : public TileByTile {
 public:
  MbtilesFile(fs::path path, const MapFacts& facts) : path_(std::move(path)), facts_(facts) { writer_.emplace(path_); }

  std::optional<Bytes> read_back(const TileKey& key) override {
    if (!reader_) reader_.emplace(path_);
    return reader_->read(key);
  }

 private:
  void add(const TileKey& key, ByteView bytes) override { writer_->add(key, bytes); }
  void finish() override {
    const LonLatBox& box = facts_.bounds;
    writer_->set_metadata({{"name", facts_.name},
                           {"format", extension_of(facts_.format)},
                           {"type", "baselayer"},
                           {"version", std::to_string(facts_.version)},
                           {"description", facts_.description},
                           {"attribution", facts_.attribution},
                           {"minzoom", std::to_string(facts_.zoom.min)},
                           {"maxzoom", std::to_string(facts_.zoom.max)},
                           {"bounds", fmt::format("{:.7f},{:.7f},{:.7f},{:.7f}", box.west_deg, box.south_deg,
                                                  box.east_deg, box.north_deg)},
                           {"center", fmt::format("{:.7f},{:.7f},{}", (box.west_deg + box.east_deg) / 2,
                                                  (box.south_deg + box.north_deg) / 2, facts_.zoom.min)}});
    writer_->finish();
    writer_.reset();
  }

  fs::path path_;
  const MapFacts& facts_;
  std::optional<MbtilesWriter> writer_;
  std::optional<MbtilesReader> reader_;
};

// GeoPackage 1.3, clause 2.2 (tiles). application_id is "GPKG".
constexpr const char* kBeginGeopackage = R"sql(
PRAGMA page_size = 4096;
PRAGMA journal_mode = OFF;
PRAGMA synchronous = OFF;
PRAGMA locking_mode = EXCLUSIVE;
PRAGMA encoding = 'UTF-8';
PRAGMA application_id = 0x47504b47;
PRAGMA user_version = 10300;
BEGIN;
CREATE TABLE gpkg_spatial_ref_sys (
  srs_name TEXT NOT NULL,
  srs_id INTEGER NOT NULL PRIMARY KEY,
  organization TEXT NOT NULL,
  organization_coordsys_id INTEGER NOT NULL,
  definition TEXT NOT NULL,
  description TEXT
);
CREATE TABLE gpkg_contents (
  table_name TEXT NOT NULL PRIMARY KEY,
  data_type TEXT NOT NULL,
  identifier TEXT UNIQUE,
  description TEXT DEFAULT '',
  last_change DATETIME NOT NULL DEFAULT (strftime('%Y-%m-%dT%H:%M:%fZ','now')),
  min_x DOUBLE,
  min_y DOUBLE,
  max_x DOUBLE,
  max_y DOUBLE,
  srs_id INTEGER,
  CONSTRAINT fk_gc_r_srs_id FOREIGN KEY (srs_id) REFERENCES gpkg_spatial_ref_sys(srs_id)
);
CREATE TABLE gpkg_tile_matrix_set (
  table_name TEXT NOT NULL PRIMARY KEY,
  srs_id INTEGER NOT NULL,
  min_x DOUBLE NOT NULL,
  min_y DOUBLE NOT NULL,
  max_x DOUBLE NOT NULL,
  max_y DOUBLE NOT NULL,
  CONSTRAINT fk_gtms_table_name FOREIGN KEY (table_name) REFERENCES gpkg_contents(table_name),
  CONSTRAINT fk_gtms_srs FOREIGN KEY (srs_id) REFERENCES gpkg_spatial_ref_sys(srs_id)
);
CREATE TABLE gpkg_tile_matrix (
  table_name TEXT NOT NULL,
  zoom_level INTEGER NOT NULL,
  matrix_width INTEGER NOT NULL,
  matrix_height INTEGER NOT NULL,
  tile_width INTEGER NOT NULL,
  tile_height INTEGER NOT NULL,
  pixel_x_size DOUBLE NOT NULL,
  pixel_y_size DOUBLE NOT NULL,
  CONSTRAINT pk_ttm PRIMARY KEY (table_name, zoom_level),
  CONSTRAINT fk_tmm_table_name FOREIGN KEY (table_name) REFERENCES gpkg_contents(table_name)
);
CREATE TABLE gpkg_extensions (
  table_name TEXT,
  column_name TEXT,
  extension_name TEXT NOT NULL,
  definition TEXT NOT NULL,
  scope TEXT NOT NULL,
  CONSTRAINT ge_tce UNIQUE (table_name, column_name, extension_name)
);
CREATE TABLE imagery (
  id INTEGER PRIMARY KEY AUTOINCREMENT,
  zoom_level INTEGER NOT NULL,
  tile_column INTEGER NOT NULL,
  tile_row INTEGER NOT NULL,
  tile_data BLOB NOT NULL,
  UNIQUE (zoom_level, tile_column, tile_row)
);
INSERT INTO gpkg_spatial_ref_sys VALUES
  ('Undefined Cartesian SRS', -1, 'NONE', -1, 'undefined', 'undefined Cartesian coordinate reference system'),
  ('Undefined geographic SRS', 0, 'NONE', 0, 'undefined', 'undefined geographic coordinate reference system'),
  ('WGS 84 geodetic', 4326, 'EPSG', 4326,
   'GEOGCS["WGS 84",DATUM["WGS_1984",SPHEROID["WGS 84",6378137,298.257223563,AUTHORITY["EPSG","7030"]],AUTHORITY["EPSG","6326"]],PRIMEM["Greenwich",0,AUTHORITY["EPSG","8901"]],UNIT["degree",0.0174532925199433,AUTHORITY["EPSG","9122"]],AXIS["Latitude",NORTH],AXIS["Longitude",EAST],AUTHORITY["EPSG","4326"]]',
   'longitude/latitude coordinates in decimal degrees on the WGS 84 spheroid'),
  ('WGS 84 / Pseudo-Mercator', 3857, 'EPSG', 3857,
   'PROJCS["WGS 84 / Pseudo-Mercator",GEOGCS["WGS 84",DATUM["WGS_1984",SPHEROID["WGS 84",6378137,298.257223563,AUTHORITY["EPSG","7030"]],AUTHORITY["EPSG","6326"]],PRIMEM["Greenwich",0,AUTHORITY["EPSG","8901"]],UNIT["degree",0.0174532925199433,AUTHORITY["EPSG","9122"]],AUTHORITY["EPSG","4326"]],PROJECTION["Mercator_1SP"],PARAMETER["central_meridian",0],PARAMETER["scale_factor",1],PARAMETER["false_easting",0],PARAMETER["false_northing",0],UNIT["metre",1,AUTHORITY["EPSG","9001"]],AXIS["Easting",EAST],AXIS["Northing",NORTH],EXTENSION["PROJ4","+proj=merc +a=6378137 +b=6378137 +lat_ts=0 +lon_0=0 +x_0=0 +y_0=0 +k=1 +units=m +nadgrids=@null +wktext +no_defs"],AUTHORITY["EPSG","3857"]]',
   'Web Mercator');
)sql";

class GeopackageFile final : public TileByTile {
 public:
  GeopackageFile(fs::path path, const MapFacts& facts) : path_(std::move(path)) {
    SqliteDatabase& database = database_.emplace(SqliteDatabase::create(path_));
    database.execute(kBeginGeopackage);
    const MercatorXY low = mercator_from_lonlat({facts.bounds.west_deg, facts.bounds.south_deg}),
                     high = mercator_from_lonlat({facts.bounds.east_deg, facts.bounds.north_deg});
    const std::string created = to_rfc3339(facts.created);
    const std::string changed = created.substr(0, created.size() - 1) + ".000Z";
    const std::string description = facts.description + "; attribution: " + facts.attribution;
    database.prepare("INSERT INTO gpkg_contents VALUES ('imagery', 'tiles', ?, ?, ?, ?, ?, ?, ?, 3857)")
        .bind(1, std::string_view(facts.name))
        .bind(2, std::string_view(description))
        .bind(3, std::string_view(changed))
        .bind_real(4, low.x_m)
        .bind_real(5, low.y_m)
        .bind_real(6, high.x_m)
        .bind_real(7, high.y_m)
        .run();
    auto set = database.prepare("INSERT INTO gpkg_tile_matrix_set VALUES ('imagery', 3857, ?, ?, ?, ?)");
    for (int i = 1; i <= 4; ++i) set.bind_real(i, i <= 2 ? -kMercatorHalfWorld_m : kMercatorHalfWorld_m);
    set.run();
    auto matrix = database.prepare("INSERT INTO gpkg_tile_matrix VALUES ('imagery', ?, ?, ?, 256, 256, ?, ?)");
    for (int zoom = facts.zoom.min; zoom <= facts.zoom.max; ++zoom) {
      matrix.bind(1, std::int64_t{zoom}).bind(2, std::int64_t{1} << zoom).bind(3, std::int64_t{1} << zoom);
      matrix.bind_real(4, mercator_pixel_m(zoom)).bind_real(5, mercator_pixel_m(zoom)).run();
    }
    if (facts.format == ImageFormat::webp) {
      database.execute(
          "INSERT INTO gpkg_extensions VALUES ('imagery', 'tile_data', 'gpkg_webp',"
          " 'http://www.geopackage.org/spec130/#extension_tiles_webp', 'read-write')");
    }
    insert_ =
        database.prepare("INSERT INTO imagery (zoom_level, tile_column, tile_row, tile_data) VALUES (?, ?, ?, ?)");
  }

  std::optional<Bytes> read_back(const TileKey& key) override {
    if (!select_) {
      database_.emplace(SqliteDatabase::open_immutable(path_));
      select_ =
          database_->prepare("SELECT tile_data FROM imagery WHERE zoom_level = ? AND tile_column = ? AND tile_row = ?");
    }
    select_->reset();
    select_->bind(1, std::int64_t{key.z}).bind(2, std::int64_t{key.x}).bind(3, std::int64_t{key.y});
    if (!select_->step()) return std::nullopt;
    const ByteView bytes = select_->blob(0);
    return Bytes(bytes.begin(), bytes.end());
  }

 private:
  void add(const TileKey& key, ByteView bytes) override {
    insert_->bind(1, std::int64_t{key.z}).bind(2, std::int64_t{key.x}).bind(3, std::int64_t{key.y});
    insert_->bind(4, bytes).run();
  }
  void finish() override {
    insert_.reset();
    database_->execute("COMMIT; PRAGMA journal_mode = DELETE;");
    database_->close();
    database_.reset();
  }

  fs::path path_;
  std::optional<SqliteDatabase> database_;
  std::optional<SqliteStatement> insert_, select_;
};

class TileFolder final : public TileByTile {
 public:
  TileFolder(fs::path folder, const MapFacts& facts, bool mission_planner)
      : folder_(std::move(folder)),
        facts_(facts),
        mission_planner_(mission_planner),
        extension_(mission_planner ? "jpg" : extension_of(facts.format)) {}

  std::optional<Bytes> read_back(const TileKey& key) override { return read_file(path_of(key)); }

 private:
  fs::path path_of(const TileKey& key) const {
    if (mission_planner_)
      return folder_ / fmt::format("TileDBv3/en/Custom/{}/{}/{}.{}", key.z, key.y, key.x, extension_);
    return folder_ / fmt::format("{}/{}/{}.{}", key.z, key.x, key.y, extension_);
  }
  void add(const TileKey& key, ByteView bytes) override {
    const fs::path path = path_of(key);
    fs::create_directories(path.parent_path());
    AppendFile(path).append(bytes);
  }
  void finish() override {
    if (mission_planner_) return;
    const LonLatBox& box = facts_.bounds;
    const json tilejson{{"tilejson", "3.0.0"},
                        {"tiles", {"{z}/{x}/{y}." + extension_}},
                        {"scheme", "xyz"},
                        {"name", facts_.name},
                        {"description", facts_.description},
                        {"attribution", facts_.attribution},
                        {"version", fmt::format("{}.0.0", facts_.version)},
                        {"minzoom", facts_.zoom.min},
                        {"maxzoom", facts_.zoom.max},
                        {"bounds", {box.west_deg, box.south_deg, box.east_deg, box.north_deg}}};
    AppendFile(folder_ / "tiles.json").append(as_bytes(tilejson.dump(1) + "\n"));
  }

  fs::path folder_;
  const MapFacts& facts_;
  bool mission_planner_;
  std::string extension_;
};

std::unique_ptr<TileFile> make_file(TileExportFormat format, const fs::path& path, const MapFacts& facts) {
  switch (format) {
    case TileExportFormat::pmtiles: return std::make_unique<PmtilesFile>(path, facts);
    case TileExportFormat::gpkg: return std::make_unique<GeopackageFile>(path, facts);
    case TileExportFormat::mbtiles: return std::make_unique<MbtilesFile>(path, facts);
    case TileExportFormat::xyz: return std::make_unique<TileFolder>(path, facts, false);
    case TileExportFormat::mission_planner: return std::make_unique<TileFolder>(path, facts, true);
  }
  return nullptr;
}

bool is_folder(TileExportFormat format) {
  return format == TileExportFormat::xyz || format == TileExportFormat::mission_planner;
}

[[noreturn]] void differs(const fs::path& where, const TileKey& key, std::string found) {
  throw Error({.what = "the export does not hold the signed tiles",
               .where = fmt::format("{}, tile {}", where.string(), to_text(key)),
               .expected = "the bytes that the package's manifest states",
               .found = std::move(found),
               .fix = "check both storage media, and export again"});
}

// Fills staging with the output, under `path`.
void write_and_compare(const TileExportRequest& request, const Verification& package, const fs::path& path,
                       ExportedTiles& exported, Progress& progress) {
  const MapFacts facts = facts_of(package);
  if (request.format == TileExportFormat::mission_planner && facts.format == ImageFormat::webp) {
    throw UsageError({.what = "Mission Planner cannot show these tiles",
                      .where = request.package,
                      .expected = "tiles of JPEG or PNG",
                      .found = "WebP",
                      .fix = "build the package with --format jpeg, or export it as mbtiles for QGroundControl"});
  }
  const CheckedTiles tiles(package.imagery->duplicate(), package.tiles);
  const auto read = [&](const TileKey& key) {
    std::optional<Bytes> bytes = tiles.read(key);
    if (!bytes) differs(request.package, key, "others, or none, although the package was verified a moment ago");
    return std::move(*bytes);
  };
  const std::unique_ptr<TileFile> file = make_file(request.format, path, facts);
  exported.tiles = package.tiles.size();
  exported.contents = file->write(package.tiles, read, progress);
  progress.begin("comparing", package.tiles.size(), "tiles");
  for (const Sidecar& tile : package.tiles) {
    const std::optional<Bytes> bytes = file->read_back(tile.key);
    if (!bytes || sha256(*bytes) != tile.sha256) differs(path, tile.key, bytes ? "others" : "none");
    progress.advance();
  }
  progress.end();
}

}  // namespace

std::string_view name_of(TileExportFormat format) {
  return std::find_if(kNames.begin(), kNames.end(), [format](const auto& name) { return name.first == format; })
      ->second;
}

std::optional<TileExportFormat> parse_tile_export_format(std::string_view name) {
  for (const auto& [format, known] : kNames) {
    if (name == known) return format;
  }
  return std::nullopt;
}

ExportedTiles export_tiles(const TileExportRequest& request, Progress& progress) {
  fs::path out = request.out;
  if (!out.has_filename()) out = out.parent_path();  // "tiles/" means "tiles"
  if (fs::exists(fs::symlink_status(out))) {
    throw UsageError({.what = "the output exists already",
                      .where = out,
                      .expected = "a path that does not exist: existing output is never changed",
                      .fix = "choose another --out, or remove the old one"});
  }
  VerifyOptions options;
  options.root = request.root;
  options.depth = VerifyDepth::full;
  options.at = request.at;
  const Verification package = verify_package(request.package, options, progress);
  ExportedTiles exported;
  exported.findings = package.findings;
  if (!package.accepted()) return exported;
  if (is_folder(request.format)) {
    StagingDirectory staging(out);
    write_and_compare(request, package, staging.path(), exported, progress);
    for (const auto& entry : fs::recursive_directory_iterator(staging.path())) {
      if (entry.is_regular_file()) exported.bytes += entry.file_size();
    }
    staging.commit();
    return exported;
  }
  // A folder holds the file until it is whole.
  const fs::path folder = out.has_parent_path() ? out.parent_path() : fs::path(".");
  StagingDirectory staging(folder / (out.filename().string() + ".export"));
  const fs::path written = staging.path() / out.filename();
  write_and_compare(request, package, written, exported, progress);
  exported.bytes = fs::file_size(written);
  sync_to_disk(written);
  fs::rename(written, out);
  sync_to_disk(folder);
  return exported;
}

}  // namespace nadir
