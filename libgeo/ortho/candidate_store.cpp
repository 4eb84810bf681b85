#include "ortho/candidate_store.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

#include "base/error.hpp"
#include "geodesy/hypotenuse.hpp"
#include "geodesy/web_mercator.hpp"

namespace nadir {
namespace {

constexpr double kSharp_ppm = 100'000;  // sharper counts the same
constexpr double kSoft_mm = 1e6;        // above every cost that is not soft

std::string folder_made(const std::filesystem::path& folder) {
  std::error_code code;
  std::filesystem::create_directories(folder, code);
  if (!std::filesystem::is_directory(folder)) {
    throw UsageError({.what = "cannot use this folder for candidate tiles",
                      .where = folder.string(),
                      .expected = "a folder, or a path where one can be created",
                      .found = code ? code.message() : "something else"});
  }
  return (folder / kCandidateFile).string();
}

std::string_view mbtiles_name_of(ImageFormat format) { return format == ImageFormat::jpeg ? "jpg" : name_of(format); }

}  // namespace

double sharpness_factor(std::int64_t sharpness_ppm) {
  return 0.5 + 0.5 * std::min(1.0, static_cast<double>(sharpness_ppm) / kSharp_ppm);
}

double cost_mm(const CandidateSidecar& sidecar) {
  const double view_rad = static_cast<double>(sidecar.quality.view_angle_mdeg) / 1000 * std::numbers::pi / 180;
  const double aslant_mm = kUnmodelledRelief_mm * std::tan(std::min(view_rad, 1.5));
  const double misplaced_mm = hypotenuse(static_cast<double>(sidecar.pose.sigma_mm), aslant_mm);
  return misplaced_mm / sharpness_factor(sidecar.quality.sharpness_ppm) +
         (sidecar.trust == CandidateTrust::soft ? kSoft_mm : 0);
}

std::string_view name_of(CandidateOutcome outcome) {
  switch (outcome) {
    case CandidateOutcome::added: return "added";
    case CandidateOutcome::replaced: return "replaced";
    case CandidateOutcome::worse: return "worse";
    case CandidateOutcome::no_room: return "no_room";
  }
  return "no_room";
}

CandidateStore::CandidateStore(const std::filesystem::path& folder, const CandidateStoreOptions& options)
    : options_(options), database_(SqliteDatabase::open_writable(folder_made(folder))) {
  if (options_.format == ImageFormat::png) {
    throw UsageError({.what = "candidate tiles are photographs", .expected = "jpeg or webp", .found = "png"});
  }
  // One writer. The journal is emptied with each commit, and that is synced: what was committed survives a power loss.
  database_->execute(
      "PRAGMA locking_mode = EXCLUSIVE; PRAGMA journal_mode = TRUNCATE; PRAGMA synchronous = FULL;"
      "PRAGMA cache_size = -4096; PRAGMA encoding = 'UTF-8';");
  database_->execute("BEGIN EXCLUSIVE");
  try {
    create_or_check_tables();
    count();
    set_metadata("nadir_clean_shutdown", "0");
    database_->execute("COMMIT");
  } catch (...) {
    database_.reset();  // rolls back
    throw;
  }
}

CandidateStore::~CandidateStore() = default;

void CandidateStore::create_or_check_tables() {
  auto count = database_->prepare("SELECT count(*) FROM sqlite_master");
  count.step();
  if (count.integer(0) == 0) {
    count.reset();
    database_->execute(
        "PRAGMA application_id = 0x4d504258;"  // "MPBX", as the specification asks
        "CREATE TABLE metadata (name TEXT, value TEXT);"
        "CREATE TABLE tiles (zoom_level INTEGER, tile_column INTEGER, tile_row INTEGER, tile_data BLOB);"
        "CREATE UNIQUE INDEX tile_index ON tiles (zoom_level, tile_column, tile_row);"
        "CREATE TABLE nadir_candidates (zoom_level INTEGER, tile_column INTEGER, tile_row INTEGER, sidecar TEXT,"
        " keyid TEXT, signature BLOB, PRIMARY KEY (zoom_level, tile_column, tile_row)) WITHOUT ROWID;");
    for (const auto& [name, value] : {std::pair<std::string_view, std::string_view>{"name", "candidate tiles"},
                                      {"format", mbtiles_name_of(options_.format)},
                                      {"type", "overlay"},
                                      {"version", "1.3"},
                                      {"description", "made in flight; nobody has judged them"}}) {
      set_metadata(name, value);
    }
    return;
  }
  count.reset();
  if (!database_->has_table("nadir_candidates")) {
    throw UsageError({.what = "not a candidate tile store",
                      .where = database_->path().string(),
                      .expected = "an empty folder, or one with an earlier flight's candidate tiles",
                      .found = "another kind of tile set",
                      .fix = "choose another folder; packages are never written to"});
  }
  auto format = database_->prepare("SELECT value FROM metadata WHERE name = 'format'");
  if (!format.step() || format.text(0) != mbtiles_name_of(options_.format)) {
    throw UsageError({.what = "the candidate tiles have another format",
                      .where = database_->path().string(),
                      .expected = std::string(mbtiles_name_of(options_.format)),
                      .fix = "choose another folder, or the existing format"});
  }
}

void CandidateStore::count() {
  auto sums = database_->prepare(
      "SELECT count(*), coalesce(sum(length(t.tile_data) + length(CAST(c.sidecar AS BLOB))), 0) "
      "FROM nadir_candidates c JOIN tiles t USING (zoom_level, tile_column, tile_row)");
  sums.step();
  tiles_ = static_cast<std::uint64_t>(sums.integer(0));
  bytes_ = static_cast<std::uint64_t>(sums.integer(1));
}

std::optional<CandidateStore::Kept> CandidateStore::kept(const TileKey& key) {
  auto row = database_->prepare(
      "SELECT c.sidecar, length(t.tile_data) FROM nadir_candidates c JOIN tiles t USING (zoom_level, tile_column, "
      "tile_row) WHERE zoom_level = ? AND tile_column = ? AND tile_row = ?");
  row.bind(1, std::int64_t{key.z}).bind(2, std::int64_t{key.x}).bind(3, std::int64_t{key.tms_row()});
  if (!row.step()) return std::nullopt;
  const std::string_view sidecar = row.text(0);
  Kept kept{std::numeric_limits<double>::infinity(), sidecar.size() + static_cast<std::uint64_t>(row.integer(1))};
  try {
    kept.cost_mm = cost_mm(parse_candidate(sidecar, database_->path().string()));
  } catch (const Error&) {
    // Damaged: any candidate is better.
  }
  return kept;
}

bool CandidateStore::wants(const CandidateSidecar& sidecar) {
  const auto there = kept(sidecar.key);
  return there ? cost_mm(sidecar) < there->cost_mm : bytes_ < options_.budget_bytes;
}

CandidateOutcome CandidateStore::put_one(const Candidate& candidate) {
  const CandidateSidecar& sidecar = candidate.sidecar;
  const auto there = kept(sidecar.key);
  if (there && cost_mm(sidecar) >= there->cost_mm) return CandidateOutcome::worse;
  const std::uint64_t freed = there ? there->bytes : 0;
  const std::uint64_t needed = candidate.tile.size() + candidate.sidecar_bytes.size();
  if (bytes_ - freed + needed > options_.budget_bytes) return CandidateOutcome::no_room;
  auto tile = database_->prepare("INSERT OR REPLACE INTO tiles VALUES (?, ?, ?, ?)");
  auto row = database_->prepare("INSERT OR REPLACE INTO nadir_candidates VALUES (?, ?, ?, ?, ?, ?)");
  for (auto* statement : {&tile, &row}) {
    statement->bind(1, std::int64_t{sidecar.key.z}).bind(2, std::int64_t{sidecar.key.x});
    statement->bind(3, std::int64_t{sidecar.key.tms_row()});
  }
  tile.bind(4, ByteView(candidate.tile)).run();
  row.bind(4, std::string_view(candidate.sidecar_bytes)).bind(5, std::string_view(candidate.signature.keyid));
  row.bind(6, ByteView(candidate.signature.signature)).run();
  bytes_ = bytes_ - freed + needed;
  if (!there) ++tiles_;
  return there ? CandidateOutcome::replaced : CandidateOutcome::added;
}

std::vector<CandidateOutcome> CandidateStore::put(std::span<const Candidate> candidates) {
  std::vector<CandidateOutcome> outcomes;
  const std::uint64_t tiles_before = tiles_, bytes_before = bytes_;
  try {
    database_->transaction([&] {
      for (const Candidate& candidate : candidates) {
        if (sha256(candidate.tile) != candidate.sidecar.sha256 || candidate.tile.size() != candidate.sidecar.size ||
            candidate.sidecar.format != options_.format) {
          throw Error({.what = "a candidate tile does not match its sidecar", .where = to_text(candidate.sidecar.key)});
        }
        outcomes.push_back(put_one(candidate));
      }
    });
  } catch (...) {
    tiles_ = tiles_before, bytes_ = bytes_before;
    throw;
  }
  return outcomes;
}

void CandidateStore::set_metadata(std::string_view name, std::string_view value) {
  database_->prepare("DELETE FROM metadata WHERE name = ?").bind(1, name).run();
  database_->prepare("INSERT INTO metadata VALUES (?, ?)").bind(1, name).bind(2, value).run();
}

void CandidateStore::set_bounds() {
  auto range = database_->prepare(
      "SELECT min(zoom_level), max(zoom_level), min(tile_column), max(tile_column), min(tile_row), max(tile_row) "
      "FROM tiles WHERE zoom_level = (SELECT max(zoom_level) FROM tiles)");
  if (!range.step() || range.is_null(0)) return;
  const auto z = static_cast<std::uint8_t>(range.integer(1));
  const auto place = [&](int column, int row) {
    return bounds_of(TileKey::from_tms(z, static_cast<std::uint32_t>(range.integer(column)),
                                       static_cast<std::uint32_t>(range.integer(row))));
  };
  const LonLatBox south_west = place(2, 4), north_east = place(3, 5);
  range.reset();
  set_metadata("bounds", fmt::format("{:.7f},{:.7f},{:.7f},{:.7f}", south_west.west_deg, south_west.south_deg,
                                     north_east.east_deg, north_east.north_deg));
  set_metadata("minzoom", std::to_string(z));
  set_metadata("maxzoom", std::to_string(z));
}

void CandidateStore::close() {
  database_->transaction([this] {
    set_bounds();
    set_metadata("nadir_clean_shutdown", "1");
  });
  database_->execute("PRAGMA journal_mode = DELETE");
  database_->close();
}

namespace {

constexpr std::size_t kSignatureSize = 64;

SqliteDatabase opened(const std::filesystem::path& folder) {
  const std::filesystem::path path = folder / kCandidateFile;
  std::filesystem::path journal = path;
  journal += "-journal";
  std::error_code code;
  if (std::filesystem::exists(path, code) && std::filesystem::exists(journal, code)) {
    // The writer was killed or is still at work. SQLite rolls back in the one case and is refused in the other.
    SqliteDatabase database = SqliteDatabase::open_writable(path);
    database.execute("PRAGMA journal_mode = DELETE; BEGIN EXCLUSIVE; COMMIT;");
    database.close();
  }
  return SqliteDatabase::open_immutable(path);
}

[[noreturn]] void refuse(const char* expected, std::string found) {
  throw Error({.what = "the row is not a candidate tile", .expected = expected, .found = std::move(found)});
}

}  // namespace

CandidateReader::CandidateReader(const std::filesystem::path& folder)
    : database_(std::make_unique<SqliteDatabase>(opened(folder))) {
  for (const char* table : {"metadata", "tiles", "nadir_candidates"}) {
    if (!database_->has_table(table)) {
      throw Error({.what = "not a candidate tile store",
                   .where = path().string(),
                   .expected = "the tables metadata, tiles and nadir_candidates",
                   .found = fmt::format("no table \"{}\"", table),
                   .fix = "give the folder that a flight wrote its candidates to"});
    }
  }
  rows_ = database_->prepare(
      "SELECT c.zoom_level, c.tile_column, c.tile_row, c.sidecar, c.keyid, c.signature, t.tile_data "
      "FROM nadir_candidates c LEFT JOIN tiles t USING (zoom_level, tile_column, tile_row) "
      "ORDER BY c.zoom_level, c.tile_column, c.tile_row DESC");
}

Candidate CandidateReader::candidate_from_row() {
  const std::int64_t z = rows_->integer(0), column = rows_->integer(1), row = rows_->integer(2);
  if (z < 0 || z > kMaxZoom || column < 0 || row < 0 || column >> z != 0 || row >> z != 0) {
    refuse("an address in the grid", fmt::format("{}/{}/{} (TMS)", z, column, row));
  }
  Candidate candidate;
  candidate.sidecar_bytes = std::string(rows_->text(3));
  candidate.sidecar = parse_candidate(candidate.sidecar_bytes, "its sidecar");
  const TileKey key = TileKey::from_tms(static_cast<std::uint8_t>(z), static_cast<std::uint32_t>(column),
                                        static_cast<std::uint32_t>(row));
  if (candidate.sidecar.key != key) refuse("a sidecar with this address", to_text(candidate.sidecar.key));
  candidate.signature.keyid = std::string(rows_->text(4));
  if (!Sha256::from_hex(candidate.signature.keyid)) refuse("a key's id", "something else");
  const ByteView signature = rows_->blob(5), tile = rows_->blob(6);
  if (signature.size() != kSignatureSize) refuse("a signature of 64 bytes", fmt::format("{} bytes", signature.size()));
  candidate.signature.signature.assign(signature.begin(), signature.end());
  if (tile.size() != candidate.sidecar.size || sha256(tile) != candidate.sidecar.sha256) {
    refuse("the tile described by the sidecar", tile.empty() ? "no tile" : "different bytes");
  }
  candidate.tile.assign(tile.begin(), tile.end());
  return candidate;
}

std::optional<Candidate> CandidateReader::next(Findings& findings) {
  while (rows_->step()) {
    try {
      return candidate_from_row();
    } catch (const Error& error) {
      findings.add({.code = "candidate.damaged",
                    .where = fmt::format("{}: zoom {}, column {}, row {} (TMS)", path().string(), rows_->integer(0),
                                         rows_->integer(1), rows_->integer(2)),
                    .expected = error.text().expected,
                    .found = error.text().found,
                    .fix = "this tile is skipped; the others are read"});
    }
  }
  return std::nullopt;
}

std::uint64_t CandidateReader::rows() const {
  auto count = database_->prepare("SELECT count(*) FROM nadir_candidates");
  count.step();
  return static_cast<std::uint64_t>(count.integer(0));
}

bool CandidateReader::clean_shutdown() const {
  auto mark = database_->prepare("SELECT value FROM metadata WHERE name = 'nadir_clean_shutdown'");
  return mark.step() && mark.text(0) == "1";
}

}  // namespace nadir
