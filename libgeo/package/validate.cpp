#include "package/validate.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <map>
#include <optional>
#include <set>

#include "base/error.hpp"
#include "base/input_file.hpp"
#include "base/number_text.hpp"
#include "base/printable.hpp"
#include "geodesy/web_mercator.hpp"
#include "imagery/codecs.hpp"
#include "package/coverage_requirement.hpp"
#include "package/mission_check.hpp"
#include "package/tile_container.hpp"
#include "package/tile_image.hpp"

namespace nadir {
namespace {

constexpr std::size_t kWalFlag_at = 18;  // "file format write version" of SQLite's header: 2 is WAL
constexpr int kFaultsNamed = 5;

// What an iteration over the tiles found.
struct TileExtent {
  std::map<int, TileKey> west, east, north, south;  // by zoom: the outermost tile to each side
  std::set<ImageFormat> formats;

  void add(const TileKey& key, std::optional<ImageFormat> format);
  bool empty() const { return west.empty(); }
};

void keep(std::map<int, TileKey>& side, const TileKey& key, bool further) {
  const auto [place, fresh] = side.emplace(key.z, key);
  if (!fresh && further) place->second = key;
}

Finding mismatch(std::string_view name, std::string expected, std::string_view found) {
  return {.code = "metadata.mismatch",
          .severity = Severity::warning,
          .where = fmt::format("metadata, {}", name),
          .expected = std::move(expected),
          .found = printable(found.substr(0, 80)),
          .fix = "write the actual value: other programs rely on it"};
}

std::optional<ImageFormat> stated_format(std::string_view text) {
  if (text == "jpg" || text == "image/jpeg") return ImageFormat::jpeg;
  return parse_image_format(text.starts_with("image/") ? text.substr(6) : text);
}

std::optional<std::array<double, 4>> parse_bounds(std::string_view text) {
  std::array<double, 4> numbers{};
  for (std::size_t i = 0; i < numbers.size(); ++i) {
    while (!text.empty() && text.front() == ' ') text.remove_prefix(1);
    const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), numbers[i]);
    if (error != std::errc{} || !(numbers[i] >= -180 && numbers[i] <= 180)) return std::nullopt;
    text.remove_prefix(static_cast<std::size_t>(end - text.data()));
    while (!text.empty() && text.front() == ' ') text.remove_prefix(1);
    if (i + 1 == numbers.size()) return text.empty() ? std::optional(numbers) : std::nullopt;
    if (text.empty() || text.front() != ',') return std::nullopt;
    text.remove_prefix(1);
  }
  return std::nullopt;
}

void check_format(std::string_view stated, const TileExtent& seen, Findings& findings) {
  std::string actual;
  for (const ImageFormat format : seen.formats)
    actual += (actual.empty() ? "" : " and ") + std::string(name_of(format));
  const auto format = stated_format(stated);
  if (format && (seen.formats.empty() || seen.formats == std::set{*format})) return;
  if (!format && seen.formats.empty()) return;
  findings.add(mismatch("format", actual, stated));
}

void check_zoom(std::string_view name, std::string_view stated, int actual, Findings& findings) {
  const std::optional<int> zoom = whole_number<int>(stated);
  if (zoom == actual) return;
  Finding finding = mismatch(name, std::to_string(actual), stated);
  // GDAL announces overviews that were not requested; whether they are needed depends on the mission.
  if (name == "minzoom" && zoom && *zoom >= 0 && *zoom < actual) finding.severity = Severity::note;
  findings.add(std::move(finding));
}

// Bounds may be those of the imagery inside the outermost tiles, or of whole tiles, or be rounded: each side must lie
// in the outermost tile of the finest zoom, or one tile beside it.
void check_bounds(std::string_view stated, const TileExtent& seen, Findings& findings) {
  const int zoom = seen.west.rbegin()->first;
  const LonLatBox west = bounds_of(seen.west.at(zoom)), east = bounds_of(seen.east.at(zoom));
  const LonLatBox north = bounds_of(seen.north.at(zoom)), south = bounds_of(seen.south.at(zoom));
  const double slack_lon = west.east_deg - west.west_deg, slack_lat = north.north_deg - north.south_deg;
  const auto bounds = parse_bounds(stated);
  const auto near = [](double value, double low, double high, double slack) {
    return value >= low - slack && value <= high + slack;
  };
  if (bounds && near((*bounds)[0], west.west_deg, west.east_deg, slack_lon) &&
      near((*bounds)[1], south.south_deg, south.north_deg, slack_lat) &&
      near((*bounds)[2], east.west_deg, east.east_deg, slack_lon) &&
      near((*bounds)[3], north.south_deg, north.north_deg, slack_lat)) {
    return;
  }
  findings.add(mismatch(
      "bounds",
      fmt::format("about {:.5f},{:.5f},{:.5f},{:.5f}", west.west_deg, south.south_deg, east.east_deg, north.north_deg),
      stated));
}

void TileExtent::add(const TileKey& key, std::optional<ImageFormat> format) {
  if (format) formats.insert(*format);
  keep(west, key, !west.contains(key.z) || key.x < west.at(key.z).x);
  keep(east, key, !east.contains(key.z) || key.x > east.at(key.z).x);
  keep(north, key, !north.contains(key.z) || key.y < north.at(key.z).y);
  keep(south, key, !south.contains(key.z) || key.y > south.at(key.z).y);
}

// "sqlite.journal": a rollback journal or write-ahead log lies beside the file (its last changes are in there, or half
// of them are in the file); a file in WAL mode is a warning, because read-only media cannot serve it to others.
Findings check_journals(const std::filesystem::path& mbtiles) {
  Findings findings;
  for (const char* suffix : {"-wal", "-journal"}) {
    std::filesystem::path beside = mbtiles;
    beside += suffix;
    std::error_code none;
    if (const auto size = std::filesystem::file_size(beside, none); !none && size > 0) {
      findings.add({.code = "sqlite.journal",
                    .where = beside.filename().string(),
                    .expected = "a finished file without a journal",
                    .found = fmt::format("{} bytes that are not committed yet or must be rolled back", size),
                    .fix = "let the writing program finish, or open the file once for writing: sqlite3 FILE 'PRAGMA "
                           "journal_mode=DELETE'"});
    }
  }
  std::array<std::uint8_t, kWalFlag_at + 1> head{};
  InputFile(mbtiles).read_at(0, head);
  if (head[kWalFlag_at] == 2) {
    findings.add({.code = "sqlite.journal",
                  .severity = Severity::warning,
                  .where = mbtiles.filename().string(),
                  .expected = "journal_mode=DELETE",
                  .found = "journal_mode=WAL, which other programs cannot open on read-only media",
                  .fix = "sqlite3 FILE 'PRAGMA journal_mode=DELETE'"});
  }
  return findings;
}

// "sqlite.corrupt": what SQLite's own integrity_check says, and "tiles.unindexed": a read of one tile searches them
// all. Throws Error when the database cannot be read at all.
Findings check_database(const SqliteDatabase& database) {
  Findings findings;
  auto faults = database.prepare(fmt::format("PRAGMA integrity_check({})", kFaultsNamed));
  while (faults.step()) {
    if (faults.text(0) == "ok") continue;
    findings.add({.code = "sqlite.corrupt",
                  .where = database.path().filename().string(),
                  .expected = "an intact SQLite database",
                  .found = printable(faults.text(0).substr(0, 200)),
                  .fix = "create the file again; copying a damaged file does not repair it"});
  }
  auto plan = database.prepare(
      "EXPLAIN QUERY PLAN SELECT tile_data FROM tiles WHERE zoom_level = 1 AND tile_column = 1 AND tile_row = 1");
  while (plan.step()) {
    if (!plan.text(3).starts_with("SCAN")) continue;
    findings.add({.code = "tiles.unindexed",
                  .severity = Severity::warning,
                  .where = database.path().filename().string(),
                  .expected = "an index over zoom_level, tile_column, tile_row",
                  .found = "no index: each read of a tile scans the whole table",
                  .fix = "CREATE UNIQUE INDEX tile_index ON tiles (zoom_level, tile_column, tile_row)"});
    break;
  }
  return findings;
}

// "metadata.mismatch": what the file claims (format, zooms, bounds) is not what it holds. Refuses when the table is
// missing, because no reader opens such a file; else a warning, because others show the file at the wrong place or not.
Findings check_metadata(const SqliteDatabase& database, const TileExtent& seen) {
  Findings findings;
  if (!database.has_table("metadata")) {
    findings.add({.code = "metadata.mismatch",
                  .where = "metadata",
                  .expected = "the table that MBTiles 1.3 requires",
                  .found = "no such table",
                  .fix = "CREATE TABLE metadata (name TEXT, value TEXT), with name and format"});
    return findings;
  }
  std::map<std::string, std::string> metadata;
  auto rows =
      database.prepare("SELECT name, value FROM metadata WHERE name IN ('format', 'minzoom', 'maxzoom', 'bounds')");
  while (rows.step()) metadata.emplace(rows.text(0), rows.text(1));
  if (seen.empty()) return findings;
  // The specification demands the format and advises the rest.
  check_format(metadata.contains("format") ? metadata["format"] : "nothing", seen, findings);
  if (metadata.contains("minzoom")) check_zoom("minzoom", metadata["minzoom"], seen.west.begin()->first, findings);
  if (metadata.contains("maxzoom")) check_zoom("maxzoom", metadata["maxzoom"], seen.west.rbegin()->first, findings);
  if (metadata.contains("bounds")) check_bounds(metadata["bounds"], seen, findings);
  return findings;
}

constexpr std::size_t kNamedPerCode = 20;

class Validator {
 public:
  Validator(const std::filesystem::path& path, const Mission& mission, UtcTime at, Progress& progress)
      : path_(path), mission_(mission), at_(at), progress_(progress) {}

  Validation run() {
    try {
      container_ = open_tile_container(path_);
    } catch (const TiffError& error) {
      add(tile_set_finding(error, path_.filename().string()));
      result_.bytes = std::filesystem::file_size(path_);
      return std::move(result_);
    }
    result_.bytes = std::filesystem::file_size(path_);
    result_.findings.add(container_->remarks());
    // A damaged page ends the iteration, not the validation: what is missing behind it counts as missing.
    const SqliteDatabase* database = container_->database();
    if (database != nullptr) {
      result_.findings.add(check_journals(path_));
      guard([&] { result_.findings.add(check_database(*database)); });
    }
    guard([&] { read_sidecars_of_file(); });
    guard([&] { walk(); });
    if (database != nullptr) guard([&] { result_.findings.add(check_metadata(*database, extent_)); });
    result_.findings.add(check_coverage(mission_, tiles_));
    check_flipped();
    result_.findings.add(check_budget(mission_, result_.bytes));
    if (result_.has_sidecars) {
      result_.findings.add(check_freshness(mission_, tiles_, at_));
      result_.findings.add(check_resolution(mission_, tiles_));
    }
    result_.sidecars = std::move(tiles_);
    return std::move(result_);
  }

 private:
  template <typename Work>
  void guard(Work work) {
    try {
      work();
    } catch (const Error& error) {
      add(tile_set_finding(error, path_.filename().string()));
    }
  }

  void add(Finding finding) {
    if (++counts_[finding.code] <= kNamedPerCode) result_.findings.add(std::move(finding));
  }

  void read_sidecars_of_file() {
    const SqliteDatabase* sidecars = container_->sidecars();
    result_.has_sidecars = sidecars != nullptr;
    if (!result_.has_sidecars) return;
    SidecarRows rows = read_sidecars(*sidecars);
    result_.findings.add(rows.findings);
    for (Sidecar& sidecar : rows.sidecars) sidecars_.emplace(sidecar.key, std::move(sidecar));
  }

  void walk() {
    progress_.begin("decoding tiles", container_->count(), "tiles");
    const auto rows = container_->tiles(true);
    while (rows->next()) {
      ++result_.tiles;
      progress_.advance();
      const auto key = rows->key();
      if (!key) {
        add({.code = "tile.misaddressed",
             .where = rows->address(),
             .expected = "an address inside the grid of its zoom",
             .fix = "create the file again; copying a damaged file does not repair it"});
      } else if (!tiles_.empty() && !(tiles_.back().key < *key)) {
        add({.code = "tile.misaddressed",
             .where = "tile " + to_text(*key),
             .expected = "each tile once",
             .found = "a second tile of this address",
             .fix = "create the file again; copying a damaged file does not repair it"});
      } else {
        inspect(*key, *rows);
      }
    }
    progress_.end();
  }

  void inspect(const TileKey& key, TileCursor& row) {
    ByteView bytes;
    TileImageCheck picture;
    try {
      bytes = row.bytes();
      const auto mask = row.mask();
      if (mask && !has_valid_pixels(*mask)) return void(--result_.tiles);  // a block that is masked entirely: no tile
      picture = check_tile_image(bytes, key);
      if (mask) apply(*mask, picture);
    } catch (const Error& error) {  // of a COG: this block alone
      if (container_->kind() != "cog") throw;
      bytes = {};
      picture.problem = tile_set_finding(error, "tile " + to_text(key));
      picture.problem->code = "tile.undecodable";
    }
    // Tools pad their grids: a black tile beside the mission's area does no harm.
    if (picture.problem && picture.problem->code == "tile.blank" && !needed(key)) {
      picture.problem->severity = Severity::warning;
    }
    const auto known = sidecars_.find(key);
    const bool filled = picture.problem && picture.problem->code == "tile.fill";
    const bool usable = !picture.problem || filled || picture.problem->code == "tile.blank";
    // What a sidecar's mask leaves out may be fill.
    if (picture.problem && !(filled && known != sidecars_.end())) add(std::move(*picture.problem));
    extent_.add(key, sniff_image_format(bytes));
    Sidecar tile;
    if (known != sidecars_.end()) {
      tile = known->second;
      if (sha256(bytes) != tile.sha256) {
        add({.code = "artifact.hash",
             .where = "tile " + to_text(key),
             .expected = "the digest in its sidecar",
             .found = "different bytes",
             .fix = "create the file again; copying a damaged file does not repair it"});
      }
    } else {
      tile.key = key;
      tile.captured_at = at_;
      tile.valid_ppm = picture.valid_ppm;
      if (!picture.mask.empty()) tile.mask = encode_tile_mask(picture.mask);
    }
    // An unusable tile stays in the list without valid pixels, so that its place shows as a gap.
    if (!usable) tile.valid_ppm = 0, tile.mask.clear();
    tiles_.push_back(std::move(tile));
  }

  bool needed(const TileKey& key) {
    if (needed_.empty()) {
      for (int zoom = mission_.zoom.min; zoom <= mission_.zoom.max; ++zoom) {
        const std::vector<TileKey> keys = required_tiles(mission_, zoom);
        needed_.insert(needed_.end(), keys.begin(), keys.end());
      }
    }
    return std::binary_search(needed_.begin(), needed_.end(), key);
  }

  static bool has_valid_pixels(ByteView mask) {
    const auto pixels = decode_tile_mask(mask);
    return pixels && std::any_of(pixels->begin(), pixels->end(), [](std::uint8_t pixel) { return pixel == 255; });
  }

  // Restricts an image to the pixels that the container's mask declares valid.
  static void apply(ByteView mask, TileImageCheck& picture) {
    const auto pixels = decode_tile_mask(mask);
    if (!pixels) return;
    if (picture.mask.empty()) picture.mask.assign(pixels->size(), 255);
    std::int64_t valid = 0;
    for (std::size_t i = 0; i < pixels->size(); ++i) {
      picture.mask[i] = std::min(picture.mask[i], (*pixels)[i]);
      valid += picture.mask[i] == 255 ? 1 : 0;
    }
    picture.valid_ppm = valid * kWholeTile_ppm / static_cast<std::int64_t>(pixels->size());
  }

  // A common mistake: rows counted from the north in a format that counts from the south.
  void check_flipped() {
    if (container_->kind() == "cog") return;  // its places are those of the map
    std::size_t present = 0, mirrored = 0;
    const auto has = [&](const TileKey& key) {
      const auto found = std::lower_bound(tiles_.begin(), tiles_.end(), key,
                                          [](const Sidecar& tile, const TileKey& wanted) { return tile.key < wanted; });
      return found != tiles_.end() && found->key == key;
    };
    for (const TileKey& key : required_tiles(mission_, mission_.zoom.max)) {
      present += has(key) ? 1U : 0U;
      mirrored += has({key.z, key.x, key.tms_row()}) ? 1U : 0U;
    }
    if (present != 0 || mirrored == 0) return;
    const bool from_south = container_->kind() == "mbtiles";
    add({.code = "tile.misaddressed",
         .where = fmt::format("zoom {}, {} {}", mission_.zoom.max, mirrored, mirrored == 1 ? "tile" : "tiles"),
         .expected = from_south ? "rows counted from the south (TMS), as in MBTiles"
                                : "rows counted from the north (XYZ), as in PMTiles",
         .found = from_south ? "rows counted from the north (XYZ): tiles mirrored at the equator"
                             : "rows counted from the south (TMS): tiles mirrored at the equator",
         .fix = from_south ? "write tile_row = 2^zoom - 1 - y" : "convert the tiles again, with y = 2^zoom - 1 - row"});
  }

  const std::filesystem::path& path_;
  const Mission& mission_;
  UtcTime at_;
  Progress& progress_;
  std::unique_ptr<TileContainer> container_;
  Validation result_;
  TileExtent extent_;
  std::vector<TileKey> needed_;  // of all of the mission's zooms, in the order of TileKey; filled on first use
  std::map<TileKey, Sidecar> sidecars_;
  std::vector<Sidecar> tiles_;
  std::map<std::string, std::size_t> counts_;
};

}  // namespace

Validation validate_tile_set(const std::filesystem::path& tiles, const Mission& mission, UtcTime at,
                             Progress& progress) {
  return Validator(tiles, mission, at, progress).run();
}

}  // namespace nadir
