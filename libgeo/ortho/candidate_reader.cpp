#include "ortho/candidate_reader.hpp"

#include <fmt/format.h>

#include "base/error.hpp"

namespace nadir {
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
  throw Error({.what = "a row is no candidate", .expected = expected, .found = std::move(found)});
}

}  // namespace

CandidateReader::CandidateReader(const std::filesystem::path& folder)
    : database_(std::make_unique<SqliteDatabase>(opened(folder))) {
  for (const char* table : {"metadata", "tiles", "nadir_candidates"}) {
    if (!database_->has_table(table)) {
      throw Error({.what = "this is no store of candidate tiles",
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
  if (candidate.sidecar.key != key) refuse("a sidecar of this address", to_text(candidate.sidecar.key));
  candidate.signature.keyid = std::string(rows_->text(4));
  if (!Sha256::from_hex(candidate.signature.keyid)) refuse("a key's id", "something else");
  const ByteView signature = rows_->blob(5), tile = rows_->blob(6);
  if (signature.size() != kSignatureSize) refuse("a signature of 64 bytes", fmt::format("{} bytes", signature.size()));
  candidate.signature.signature.assign(signature.begin(), signature.end());
  if (tile.size() != candidate.sidecar.size || sha256(tile) != candidate.sidecar.sha256) {
    refuse("the tile that the sidecar names", tile.empty() ? "no tile" : "other bytes");
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
                    .fix = "this tile is lost; the others are read"});
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
