// What the candidate service's catalogue holds, as values. docs/formats/candidate-service.md describes the tables.
// Times are milliseconds since 1970 (UTC); lengths are in the units of their names.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "base/digest.hpp"
#include "catalogue/database.hpp"
#include "ortho/candidate_store.hpp"
#include "upload/batch.hpp"
#include "upload/reason_code.hpp"

namespace nadir {

// open: packs may come; judging: its tiles wait for verdicts; judged: all have one.
enum class UploadState { open = 0, judging = 1, judged = 2 };

struct UploadRow {
  std::int64_t id = 0;
  std::string name;  // the upload_id of the contract
  Sha256 batch_key;  // of client and batch: what makes announcing idempotent
  std::string batch;
  Sha256 body_sha256;
  std::string client;
  std::string airframe;
  std::string flight;
  Sha256 base_package;
  std::int64_t opened_ms = 0;
  std::int64_t expires_ms = 0;
  UploadState state = UploadState::open;
  std::int64_t tiles = 0, bytes = 0;  // that were not refused at once
};

enum class Verdict { accepted = 0, rejected = 1, duplicate = 2 };

struct Refusal {
  ReasonCode code = ReasonCode::policy;
  std::string detail;
};
inline constexpr const char* kRevokedLater = "the key that signed it was revoked after its announcement";

// What the service itself measured in a tile's image.
struct OwnMeasures {
  std::int64_t contrast_ppm = 0;
  std::int64_t sharpness_ppm = 0;
  std::optional<std::int64_t> base_shift_mm{};  // against the base package, where the two can be compared
  std::optional<std::int64_t> correlation_ppm{};
};

struct TileVerdict {
  std::int64_t tile = 0;
  Verdict verdict = Verdict::accepted;
  std::optional<Refusal> refusal{};
  std::string detail{};
  std::optional<OwnMeasures> measures{};
  bool voted = false;  // its address was voted on with it
};

inline TileVerdict revoked_verdict(std::int64_t tile) {
  return {.tile = tile,
          .verdict = Verdict::rejected,
          .refusal = Refusal{.code = ReasonCode::airframe_revoked, .detail = kRevokedLater}};
}

// Where the bytes of a digest lie.
struct BlobPlace {
  Sha256 pack;
  std::uint64_t start = 0;
  std::uint64_t bytes = 0;
};

struct TileRow {
  std::int64_t id = 0;
  std::int64_t upload = 0;
  TileKey key;
  std::int64_t place = 0;  // in its batch
  std::uint64_t size = 0;  // as announced, bytes
  Sha256 sha256;
  std::string keyid;                // of the key that signed it
  std::string sidecar;              // canonical; left empty where only the verdict is asked for
  std::optional<BlobPlace> blob{};  // none: the bytes have not come
  std::optional<Verdict> verdict{};
  std::optional<ReasonCode> code{};
  std::string detail{};
};

// An accepted tile, with what a vote compares.
struct AcceptedCandidate {
  std::int64_t tile = 0;
  CandidateSidecar sidecar;
  BlobPlace blob;
};

struct Vote {
  std::int64_t tile = 0, other = 0;  // the smaller id first
  std::int64_t shift_mm = 0;
  std::int64_t allowed_mm = 0;
  std::int64_t correlation_ppm = 0;
  bool agrees = false;
};

struct Promotion {
  std::int64_t tile = 0;
  TileKey key;
  std::int64_t decided_ms = 0;
  std::int64_t flights = 0;
  std::string evidence;  // JSON: which tiles of which flights agreed, and how well
};

// The accepted tiles of one tile address, the votes on pairs of them so far, and which of them is promoted and why.
struct AddressCandidates {
  TileKey key;
  std::vector<AcceptedCandidate> candidates{};
  std::vector<Vote> votes{};
  std::optional<std::int64_t> promoted{};
  std::string evidence{};  // of that promotion
  bool open = false;       // a candidate has come, or gone, since the last vote
};

struct Outcome {
  std::vector<Vote> new_votes;
  std::optional<Promotion> promotion;  // of another tile than before, or by other evidence
};

struct PromotedTile {
  Promotion promotion;
  CandidateSidecar sidecar;
  BlobPlace blob;
};

struct CatalogueCounts {
  std::int64_t uploads = 0, open = 0, judging = 0;
  std::int64_t tiles = 0, accepted = 0, rejected = 0, duplicate = 0;
  std::int64_t to_vote = 0, promoted = 0;
  std::int64_t claims = 0;  // of addresses that workers hold now, and how old the oldest of them is; PostGIS alone
  std::int64_t oldest_claim_ms = 0;
  std::vector<std::pair<std::string, std::int64_t>> rejected_by;  // code, tiles
};

// What an airframe has announced since some time.
struct Usage {
  std::int64_t tiles = 0;
  std::int64_t bytes = 0;
};

// How the tables' rows become these values. Each throws Error for what no service wrote.
namespace candidate_rows {
Sha256 digest(const CatalogueRow& row, const char* column);
TileKey key(const CatalogueRow& row);       // columns z, x, y
BlobPlace blob(const CatalogueRow& row);    // pack, start, bytes
UploadRow upload(const CatalogueRow& row);  // all of `uploads`
TileRow tile(const CatalogueRow& row, bool with_sidecar);
std::string quoted(std::span<const Sha256> digests);  // for IN (…)

// Tiles t (from: where they come from) of uploads u, with their bytes' place b and their verdict v.
std::vector<TileRow> select_tiles(CatalogueDatabase& database, const std::string& from,
                                  const std::string& where_and_order, bool with_sidecars);
void insert_verdicts(CatalogueDatabase& database, std::span<const TileVerdict> verdicts, std::int64_t now_ms);
}  // namespace candidate_rows

}  // namespace nadir
