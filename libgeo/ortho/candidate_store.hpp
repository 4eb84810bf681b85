// Where a flight keeps its candidate tiles: FOLDER/tiles.mbtiles, an MBTiles file with one more table for the sidecars
// (docs/formats/candidates.md). It is never the package: a file of another kind is refused, so that no trusted tile can
// be overwritten.
//
// Each put() is one transaction, on the disk when it returns: a process that is killed, or loses its power, leaves
// every tile that it put, each with its sidecar, and no partial one. Failures throw and change nothing; the store stays
// usable.
//
// CandidateReader reads such a folder from any source, and trusts nothing in it.
#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "base/error.hpp"
#include "imagery/sqlite_database.hpp"
#include "ortho/candidate_sidecar.hpp"

namespace nadir {

inline constexpr std::string_view kCandidateFile = "tiles.mbtiles";

struct Candidate {
  CandidateSidecar sidecar;
  std::string sidecar_bytes;  // canonical
  EnvelopeSignature signature;
  Bytes tile;
};

// Position uncertainty and blur as one length: the smaller the better. Soft tiles come after all others.
//
//   cost = hypot(sigma, kUnmodelledRelief_mm · tan(view angle)) / sharpness_factor
double cost_mm(const CandidateSidecar& sidecar);

inline constexpr double kUnmodelledRelief_mm = 1'500;  // displaces what is seen at an angle
double sharpness_factor(std::int64_t sharpness_ppm);   // 0.5 to 1

struct CandidateStoreOptions {
  ImageFormat format = ImageFormat::jpeg;               // of all tiles: MBTiles files hold one format
  std::uint64_t budget_bytes = std::uint64_t{4} << 30;  // tiles and sidecars together
};

enum class CandidateOutcome { added, replaced, worse, no_room };
std::string_view name_of(CandidateOutcome outcome);

class CandidateStore {
 public:
  // Creates the folder, or continues with an existing store. Throws UsageError when the folder holds something else,
  // and Error when another process writes to it.
  explicit CandidateStore(const std::filesystem::path& folder, const CandidateStoreOptions& options = {});
  ~CandidateStore();
  CandidateStore(const CandidateStore&) = delete;
  CandidateStore& operator=(const CandidateStore&) = delete;

  // All in one transaction. Of two candidates for one address the better one stays; what exceeds the budget is left
  // out. Throws Error (OutOfSpace when the disk is full): then none of them was stored.
  std::vector<CandidateOutcome> put(std::span<const Candidate> candidates);

  // Whether a tile like this would be kept: saves encoding and signing.
  bool wants(const CandidateSidecar& sidecar);

  std::uint64_t tiles() const { return tiles_; }
  std::uint64_t bytes() const { return bytes_; }

  // Closes the store: the metadata gets the tiles' bounds and nadir_clean_shutdown. Without it the mark is missing.
  void close();

 private:
  struct Kept {
    double cost_mm = 0;
    std::uint64_t bytes = 0;
  };
  void create_or_check_tables();
  void count();
  std::optional<Kept> kept(const TileKey& key);
  CandidateOutcome put_one(const Candidate& candidate);
  void set_metadata(std::string_view name, std::string_view value);
  void set_bounds();

  CandidateStoreOptions options_;
  std::optional<SqliteDatabase> database_;
  std::uint64_t tiles_ = 0, bytes_ = 0;
};

class CandidateReader {
 public:
  // Throws Error when there is no store of candidates, it is damaged, or another process writes to it.
  explicit CandidateReader(const std::filesystem::path& folder);

  // The next candidate in the order of TileKey, nullopt at the end. Its sidecar has the right form and belongs to the
  // tile's address and bytes; its signature is the caller's to check (check_candidate_signature). Rows that are no such
  // candidates are passed over and become findings `candidate.damaged`.
  std::optional<Candidate> next(Findings& findings);

  std::uint64_t rows() const;
  bool clean_shutdown() const;  // whether its writer closed it properly
  const std::filesystem::path& path() const { return database_->path(); }

 private:
  Candidate candidate_from_row();

  std::unique_ptr<SqliteDatabase> database_;  // an address of its own: statements point to it
  std::optional<SqliteStatement> rows_;
};

}  // namespace nadir
