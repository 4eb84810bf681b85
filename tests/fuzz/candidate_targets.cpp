// Candidate tiles from an aircraft that somebody may have had in his hands: sidecars, and the rows of a store.
#include "base/sha256.hpp"
#include "fuzz/any_rows.hpp"
#include "fuzz/scratch.hpp"
#include "fuzz/targets.hpp"
#include "ortho/candidate_store.hpp"

namespace nadir::fuzz {

void candidate(std::string_view bytes) {
  refusing([&] {
    const CandidateSidecar sidecar = parse_candidate(bytes, "fuzz");
    require(candidate_json(sidecar) == bytes, "two spellings of one sidecar");
    require(sidecar.key.valid(), "an address outside of the grid");
    require(cost_mm(sidecar) >= 0, "a badness that is none");
  });
}

void candidate_rows(std::string_view bytes) {
  const std::filesystem::path path = scratch_folder() / kCandidateFile;
  std::filesystem::remove(path);
  {
    const SqliteDatabase database = SqliteDatabase::create(path);
    database.execute(
        "PRAGMA journal_mode = OFF; PRAGMA synchronous = OFF; BEGIN; CREATE TABLE metadata (name, value);"
        "CREATE TABLE tiles (zoom_level, tile_column, tile_row, tile_data);"
        "CREATE TABLE nadir_candidates (zoom_level, tile_column, tile_row, sidecar, keyid, signature)");
    Source source(bytes);
    auto tile = database.prepare("INSERT INTO tiles VALUES (?, ?, ?, ?)");
    auto datum = database.prepare("INSERT INTO metadata VALUES (?, ?)");
    auto row_of_candidates = database.prepare("INSERT INTO nadir_candidates VALUES (?, ?, ?, ?, ?, ?)");
    for (int row = 0; row < 64 && !source.empty(); ++row) {
      const int kind = source.byte() % 3;
      SqliteStatement& insert = kind == 0 ? tile : kind == 1 ? datum : row_of_candidates;
      for (int column = 1; column <= (kind == 0 ? 4 : kind == 1 ? 2 : 6); ++column) bind_any(insert, column, source);
      insert.run();
    }
    database.execute("COMMIT");
  }
  refusing([&] {
    CandidateReader reader(scratch_folder().path());
    static_cast<void>(reader.clean_shutdown());
    Findings findings;
    std::uint64_t read = 0;
    while (const auto candidate = reader.next(findings)) {
      ++read;
      require(sha256(candidate->tile) == candidate->sidecar.sha256, "a tile of another digest");
      require(candidate_json(candidate->sidecar) == candidate->sidecar_bytes,
              "another sidecar than the one that is read");
    }
    require(findings.refuses() == !findings.items().empty(), "a damaged row that is no refusal");
    // A candidate comes once for each of its tiles: a table without a key may hold several.
    require(read + findings.items().size() >= reader.rows(), "a row that is neither read nor told of");
  });
}

}  // namespace nadir::fuzz
