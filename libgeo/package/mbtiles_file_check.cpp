#include "package/mbtiles_file_check.hpp"

#include <fmt/format.h>

#include <array>
#include <charconv>
#include <fstream>
#include <optional>

#include "base/printable.hpp"
#include "geodesy/web_mercator.hpp"

namespace nadir {
namespace {

constexpr std::size_t kWalFlag_at = 18;  // "file format write version" of SQLite's header: 2 is WAL
constexpr int kFaultsNamed = 5;

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
          .fix = "write what the file holds: other programs go by it"};
}

std::optional<ImageFormat> claimed_format(std::string_view text) {
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

void check_format(std::string_view claimed, const SeenTiles& seen, Findings& findings) {
  std::string held;
  for (const ImageFormat format : seen.formats) held += (held.empty() ? "" : " and ") + std::string(name_of(format));
  const auto format = claimed_format(claimed);
  if (format && (seen.formats.empty() || seen.formats == std::set{*format})) return;
  if (!format && seen.formats.empty()) return;
  findings.add(mismatch("format", held, claimed));
}

void check_zoom(std::string_view name, std::string_view claimed, int held, Findings& findings) {
  int zoom = -1;
  const auto [end, error] = std::from_chars(claimed.data(), claimed.data() + claimed.size(), zoom);
  if (error == std::errc{} && end == claimed.data() + claimed.size() && zoom == held) return;
  Finding finding = mismatch(name, std::to_string(held), claimed);
  // GDAL promises overviews that nobody asked for; whether they are needed is the mission's to say.
  if (name == "minzoom" && zoom >= 0 && zoom < held) finding.severity = Severity::note;
  findings.add(std::move(finding));
}

// Bounds may be of the picture inside of its outermost tiles, or of whole tiles, or wider by a rounding: each side must
// lie in the outermost tile of the finest zoom, or one tile beside it.
void check_bounds(std::string_view claimed, const SeenTiles& seen, Findings& findings) {
  const int zoom = seen.west.rbegin()->first;
  const LonLatBox west = bounds_of(seen.west.at(zoom)), east = bounds_of(seen.east.at(zoom));
  const LonLatBox north = bounds_of(seen.north.at(zoom)), south = bounds_of(seen.south.at(zoom));
  const double slack_lon = west.east_deg - west.west_deg, slack_lat = north.north_deg - north.south_deg;
  const auto bounds = parse_bounds(claimed);
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
      claimed));
}

}  // namespace

void SeenTiles::add(const TileKey& key, std::optional<ImageFormat> format) {
  if (format) formats.insert(*format);
  keep(west, key, !west.contains(key.z) || key.x < west.at(key.z).x);
  keep(east, key, !east.contains(key.z) || key.x > east.at(key.z).x);
  keep(north, key, !north.contains(key.z) || key.y < north.at(key.z).y);
  keep(south, key, !south.contains(key.z) || key.y > south.at(key.z).y);
}

Findings check_journals(const std::filesystem::path& mbtiles) {
  Findings findings;
  for (const char* suffix : {"-wal", "-journal"}) {
    std::filesystem::path beside = mbtiles;
    beside += suffix;
    std::error_code none;
    if (const auto size = std::filesystem::file_size(beside, none); !none && size > 0) {
      findings.add(
          {.code = "sqlite.journal",
           .where = beside.filename().string(),
           .expected = "a file that its maker has finished",
           .found = fmt::format("{} bytes that are not in the database yet, or must be taken back", size),
           .fix = "let its maker finish, or open it once for writing: sqlite3 FILE 'PRAGMA journal_mode=DELETE'"});
    }
  }
  std::array<char, kWalFlag_at + 1> head{};
  std::ifstream(mbtiles, std::ios::binary).read(head.data(), head.size());
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

Findings check_database(const SqliteDatabase& database) {
  Findings findings;
  auto faults = database.prepare(fmt::format("PRAGMA integrity_check({})", kFaultsNamed));
  while (faults.step()) {
    if (faults.text(0) == "ok") continue;
    findings.add({.code = "sqlite.corrupt",
                  .where = database.path().filename().string(),
                  .expected = "a sound SQLite database",
                  .found = printable(faults.text(0).substr(0, 200)),
                  .fix = "make the file again; a copy of a damaged file stays damaged"});
  }
  auto plan = database.prepare(
      "EXPLAIN QUERY PLAN SELECT tile_data FROM tiles WHERE zoom_level = 1 AND tile_column = 1 AND tile_row = 1");
  while (plan.step()) {
    if (!plan.text(3).starts_with("SCAN")) continue;
    findings.add({.code = "tiles.unindexed",
                  .severity = Severity::warning,
                  .where = database.path().filename().string(),
                  .expected = "an index over zoom_level, tile_column, tile_row",
                  .found = "each read of a tile searches all of them",
                  .fix = "CREATE UNIQUE INDEX tile_index ON tiles (zoom_level, tile_column, tile_row)"});
    break;
  }
  return findings;
}

Findings check_metadata(const SqliteDatabase& database, const SeenTiles& seen) {
  Findings findings;
  if (!database.has_table("metadata")) {
    findings.add({.code = "metadata.mismatch",
                  .where = "metadata",
                  .expected = "the table that MBTiles 1.3 demands",
                  .found = "no such table",
                  .fix = "CREATE TABLE metadata (name TEXT, value TEXT), with name and format"});
    return findings;
  }
  std::map<std::string, std::string> said;
  auto rows =
      database.prepare("SELECT name, value FROM metadata WHERE name IN ('format', 'minzoom', 'maxzoom', 'bounds')");
  while (rows.step()) said.emplace(rows.text(0), rows.text(1));
  if (seen.empty()) return findings;
  // The specification demands the format and advises the rest.
  check_format(said.contains("format") ? said["format"] : "nothing", seen, findings);
  if (said.contains("minzoom")) check_zoom("minzoom", said["minzoom"], seen.west.begin()->first, findings);
  if (said.contains("maxzoom")) check_zoom("maxzoom", said["maxzoom"], seen.west.rbegin()->first, findings);
  if (said.contains("bounds")) check_bounds(said["bounds"], seen, findings);
  return findings;
}

}  // namespace nadir
