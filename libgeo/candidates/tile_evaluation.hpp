// What becomes of tiles that are there: a verdict on each by its image and its base package's map, votes between
// flights at each address, and the withdrawal of what a revoked key has signed.
//
// Work comes in pieces: a call does a bounded part of it and says whether there is more. What a killed process has not
// committed is done again. A tile that cannot be read now keeps no other tile from its verdict and no other address
// from its vote. For any thread, but one at a time for each upload, and one for votes.
#pragma once

#include <cstdint>
#include <map>
#include <mutex>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "base/error.hpp"
#include "base/time.hpp"
#include "candidates/audit_log.hpp"
#include "candidates/base_maps.hpp"
#include "candidates/candidate_rules.hpp"
#include "candidates/catalogue_thread.hpp"
#include "candidates/pack_store.hpp"
#include "candidates/trust_file.hpp"

namespace nadir {

class TileEvaluation {
 public:
  // All must outlive this.
  TileEvaluation(CatalogueThread& catalogue, PackStore& packs, const BaseMaps& maps, TrustFile& trust, AuditLog& audit,
                 const Clock& clock, const CandidateRules& rules)
      : catalogue_(catalogue), packs_(packs), maps_(maps), trust_(trust), audit_(audit), clock_(clock), rules_(rules) {}

  // Uploads that wait for verdicts, with their clients' names.
  std::vector<std::pair<std::string, std::int64_t>> pending();

  // True: there is more. Both throw Error at the end, once everything else has been done, when images of some tiles
  // cannot be read: those are tried again by the next call. A tile whose bytes are damaged before its verdict is
  // rejected (hash_mismatch) and forgotten, so that it can be sent again; an Error reports it too.
  bool evaluate_some(std::int64_t upload);
  bool vote_some();

  // Tiles signed by keys that the trust root revokes by now are withdrawn, promoted or not. How many tiles; almost no
  // work while the root stays the same.
  std::int64_t apply_revocations();

 private:
  struct Unread {
    std::set<std::int64_t> tiles;  // that wait, because they cannot be read now
    std::optional<Error> why;      // the first reason, damaged ones' as well
  };
  std::optional<CandidateCatalogue::Question> evaluate(const TileRow& tile, std::int64_t upload);
  TileVerdict evaluate_tile(const TileRow& tile, const CandidateSidecar& sidecar);
  void end_evaluation(std::int64_t upload);
  Vote compare(const AcceptedCandidate& one, const AcceptedCandidate& other);

  CatalogueThread& catalogue_;
  PackStore& packs_;
  const BaseMaps& maps_;
  TrustFile& trust_;
  AuditLog& audit_;
  const Clock& clock_;
  const CandidateRules rules_;
  std::mutex mutex_;
  std::map<std::int64_t, Unread> unevaluated_;  // by upload, while it is evaluated
  std::set<TileKey> unread_;                    // addresses whose images could not be read, since the last throw
  std::optional<Error> why_unread_;             // the first of them
  std::set<std::string> applied_revocations_;   // keys whose tiles the catalogue has withdrawn
};

}  // namespace nadir
