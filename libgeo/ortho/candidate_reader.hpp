// Reads a folder of candidate tiles, whoever made it: nothing in it is believed. What a killed writer left unfinished
// is rolled back first. Not while the flight is still writing.
#pragma once

#include <filesystem>
#include <memory>
#include <optional>

#include "base/error.hpp"
#include "imagery/sqlite_database.hpp"
#include "ortho/candidate_store.hpp"

namespace nadir {

class CandidateReader {
 public:
  // Throws Error when there is no store of candidates, it is damaged, or another process writes to it.
  explicit CandidateReader(const std::filesystem::path& folder);

  // The next candidate in the order of TileKey, nullopt at the end. Its sidecar has the right form and belongs to the
  // tile's address and bytes; its signature is the caller's to check (check_candidate_signature). Rows that are no such
  // candidates are passed over and become findings `candidate.damaged`.
  std::optional<Candidate> next(Findings& findings);

  std::uint64_t rows() const;
  bool clean_shutdown() const;  // whether its writer came to an orderly end
  const std::filesystem::path& path() const { return database_->path(); }

 private:
  Candidate candidate_from_row();

  std::unique_ptr<SqliteDatabase> database_;  // an address of its own: statements point to it
  std::optional<SqliteStatement> rows_;
};

}  // namespace nadir
