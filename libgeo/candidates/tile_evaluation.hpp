// What becomes of tiles that are there: a verdict on each by its image and its base package's map, votes between
// flights at each address, and the withdrawal of what a revoked key has signed.
//
// Work comes in pieces: a call claims some addresses (address_work.hpp), does their part of it and says whether there
// is more. What a killed process has not committed is done again. A tile that cannot be read now keeps no other tile
// from its verdict and no other address from its vote.
//
// For any number of threads, here and in other processes. On PostGIS each gives a CatalogueThread of its own; on
// SpatiaLite all give the same one.
#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <memory>
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
#include "trust/root.hpp"

namespace nadir {

class TileEvaluation {
 public:
  // All must outlive this.
  // root: the trust root in force at each moment; for any thread.
  using Root = std::function<std::shared_ptr<const TrustRoot>()>;
  TileEvaluation(PackStore& packs, const BaseMaps& maps, Root root, AuditLog& audit, const Clock& clock,
                 const CandidateRules& rules)
      : packs_(packs), maps_(maps), root_(std::move(root)), audit_(audit), clock_(clock), rules_(rules) {}

  // Uploads that wait for verdicts, with their clients' names, in the order of their announcement.
  std::vector<std::pair<std::string, std::int64_t>> pending(CatalogueThread& catalogue);

  // What a call has done. More: it left something, or others hold it now.
  struct Piece {
    std::size_t tiles = 0, addresses = 0, promoted = 0;  // judged, voted on, and with another tile promoted
    bool finished = false;                               // the upload is judged
    bool more = false;
  };
  // Both throw Error at the end, once everything else has been done, when images of some tiles cannot be read: those
  // are tried again by the next call. A tile whose bytes are damaged before its verdict is rejected (hash_mismatch) and
  // forgotten, so that it can be sent again; an Error reports it too.
  // evaluate_some: verdicts on tiles of an upload, and a vote at each of their addresses. vote_some: the votes that are
  // due for another reason: a key was revoked, an image could not be read.
  Piece evaluate_some(CatalogueThread& catalogue, std::int64_t upload);
  Piece vote_some(CatalogueThread& catalogue);

  // Tiles signed by keys that the trust root revokes by now are withdrawn, promoted or not. How many tiles; almost no
  // work while the root stays the same.
  std::int64_t apply_revocations(CatalogueThread& catalogue);

 private:
  struct Unread {
    std::set<std::int64_t> tiles;  // that wait, because they cannot be read now
    std::optional<Error> why;      // the first reason, damaged ones' as well
  };
  class AddressImages;
  class ClaimGuard;
  TileVerdict judge(const TileRow& tile, const CandidateSidecar& sidecar, AddressImages& images);
  std::optional<AddressResult::Judged> judge_readable(const TileRow& tile, const CandidateSidecar& sidecar,
                                                      AddressImages& images);
  AddressResult evaluate(const AddressTask& task, std::int64_t now_ms, std::optional<Error>& why_unvoted);
  Vote compare(AddressImages& images, const AcceptedCandidate& one, const AcceptedCandidate& other);
  template <typename Unvoted>
  Piece work_on(CatalogueThread& catalogue, const AddressWork::Claim& claim, const Unvoted& unvoted);
  void end_evaluation(std::int64_t upload);

  PackStore& packs_;
  const BaseMaps& maps_;
  const Root root_;
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
