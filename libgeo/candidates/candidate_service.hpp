// The candidate service without its HTTP: takes batches and packs, evaluates tiles, lets flights vote, and stores all
// of it. For any number of threads.
//
// What a caller was answered is on the disk. A killed process resumes where it was: recover() completes what was begun,
// and every call may be repeated.
#pragma once

#include <filesystem>
#include <map>
#include <mutex>
#include <optional>
#include <set>
#include <string>
#include <variant>
#include <vector>

#include "base/error.hpp"
#include "base/time.hpp"
#include "candidates/audit_log.hpp"
#include "candidates/base_maps.hpp"
#include "candidates/candidate_rules.hpp"
#include "candidates/catalogue_rows.hpp"
#include "candidates/catalogue_thread.hpp"
#include "candidates/installed_store.hpp"
#include "candidates/pack_store.hpp"
#include "candidates/trust_file.hpp"

namespace nadir {

// Results are values: the contract of schemas/candidates.openapi.yaml without HTTP.

// Who calls, by its token.
struct UploadClient {
  std::string name;                    // whose uploads they are; several tokens may share one
  std::vector<std::string> airframes;  // that it may upload for; empty: all
  std::string token{};                 // its id, for the audit log

  bool may(std::string_view airframe) const;
};

// Why the service refuses a call.
struct Denial {
  enum class Kind {
    malformed,
    forbidden,
    not_found,
    key_reused,
    batch_invalid,
    pack_unknown,
    pack_invalid,
    pack_busy,
    offset_mismatch,
    digest_mismatch,
    too_large,
    too_many,
    incomplete,
    report_invalid,
    report_older,
    storage_full,
    unavailable
  };
  Kind kind = Kind::malformed;
  std::string detail;
  std::optional<std::uint64_t> offset{};  // with offset_mismatch and pack_busy: where the pack goes on
  std::vector<Sha256> missing{};          // with incomplete
};

// What impairs the service; an empty reason: nothing. fails: it takes no uploads.
struct ServiceFault {
  std::string reason;
  bool fails = false;
};

template <typename Result>
using Answer = std::variant<Result, Denial>;

struct Announcement {
  bool opened = false;  // just now
  std::string upload;
  std::vector<Sha256> missing{}, known{};
  std::vector<std::pair<Sha256, Refusal>> refused{};
  std::int64_t expires_ms = 0;
};

struct PackOffset {
  std::uint64_t offset = 0;
  std::optional<std::uint64_t> length{};  // of a pack that is whole
};

struct Completion {
  std::string upload;
  std::int64_t pending = 0;
};

struct UploadStatus {
  UploadRow upload;
  std::vector<TileRow> tiles;
};

struct PartHeader {
  std::uint64_t offset = 0;
  std::optional<std::uint64_t> length{};
  Sha256 digest;  // of the part
};

struct CandidateServiceOptions {
  std::filesystem::path data;  // packs/, incoming/, installed/, audit/ and the memory of the trust root
  CatalogueLocation catalogue;
  std::filesystem::path trust;
  std::vector<std::filesystem::path> packages;
  CandidateRules rules{};
  std::uint64_t part_max = std::uint64_t{1} << 20;
  std::uint64_t keep_free_bytes = std::uint64_t{1} << 30;  // of the disk; below it nothing is taken
  std::size_t packs_at_once = 4;                           // unfinished ones of an upload
  // One that has not grown for so long makes room for another: a sender that rebuilds its packs never finishes the old
  // ones. Longer than a part may take on the slowest line that is waited for.
  std::int64_t pack_rest_s = 300;
  std::int64_t upload_life_ms =
      std::int64_t{7} * 24 * 3600 * 1000;  // until an upload that is not complete is forgotten
};

class CandidateService {
 public:
  // clock: must outlive this. Throws Error.
  CandidateService(CandidateServiceOptions options, const Clock& clock);

  // After a start, before anything else: complete packs are accepted, unreferenced files are removed. What the disk
  // does not allow now is left as it is, and fault() reports it: a service that serves is worth more than one that is
  // tidy.
  void recover();

  Answer<Announcement> announce(const UploadClient& client, const std::string& key, const std::string& body);
  Answer<PackOffset> offset(const UploadClient& client, const std::string& upload, const Sha256& pack);
  // The offset after it.
  Answer<PackOffset> append(const UploadClient& client, const std::string& upload, const Sha256& pack,
                            const PartHeader& header, ByteView part);
  // evaluate: set to the upload that must be evaluated now, by evaluate_some().
  Answer<Completion> complete(const UploadClient& client, const std::string& upload,
                              std::optional<std::int64_t>& evaluate);
  Answer<UploadStatus> status(const UploadClient& client, const std::string& upload);

  // body: an aircraft's signed report of the package that it flies. known: this very report came before.
  Answer<InstalledStore::Outcome> report_installed(const UploadClient& client, const std::string& body);
  std::vector<InstalledStore::Entry> installed() const { return installed_.list(); }

  // Uploads that wait for verdicts, with their clients' names.
  std::vector<std::pair<std::string, std::int64_t>> pending_evaluations();

  // A bounded piece of work each; true: there is more. Both throw Error at the end, once everything else has been done,
  // when images of some tiles cannot be read: those are tried again by the next call. A tile whose bytes are damaged
  // before its verdict is rejected (hash_mismatch) and forgotten, so that it can be sent again; an Error reports it
  // too.
  bool evaluate_some(std::int64_t upload);
  bool vote_some();
  void forget_expired();
  // Tiles signed by keys that the trust root revokes by now are withdrawn, promoted or not. How many tiles; almost
  // no work while the root stays the same. recover() does it as well.
  std::int64_t apply_revocations();
  // Now and then: writes to the audit log what has changed by itself, such as the trust root's version.
  void keep_audit();

  CatalogueCounts counts();
  ServiceFault fault();
  std::string root_fault() { return trust_.fault(); }  // why the trust root's file is rejected; empty: it is not
  std::int64_t root_version() { return trust_.current()->version; }
  bool first_trust() const { return trust_.first_start(); }
  AuditLog& audit() { return audit_; }
  UtcTime now() const { return clock_.now(); }
  const CandidateServiceOptions& options() const { return options_; }

 private:
  friend class PackClaim;
  struct Unread {
    std::set<std::int64_t> tiles;  // that wait, because they cannot be read now
    std::optional<Error> why;      // the first reason, damaged ones' as well
  };
  std::variant<UploadRow, Denial> find(const UploadClient& client, const std::string& upload);
  Announcement announcement_of(const UploadRow& upload, bool opened);
  std::vector<std::optional<Refusal>> check_batch(const SignedBatch& batch, UtcTime now);
  std::optional<Denial> accept_pack(const UploadRow& upload, const IncomingPack& pack);
  std::optional<Denial> no_room(std::uint64_t bytes) const;
  bool evict_abandoned_pack(const std::string& upload);
  std::optional<CandidateCatalogue::Question> evaluate(const TileRow& tile, std::int64_t upload);
  void end_evaluation(std::int64_t upload);
  TileVerdict evaluate_tile(const TileRow& tile, const CandidateSidecar& sidecar);
  Vote compare(const AcceptedCandidate& one, const AcceptedCandidate& other);
  Answer<Announcement> announce_batch(const UploadClient& client, const std::string& key, const std::string& body);
  void recover_packs();

  CandidateServiceOptions options_;
  const Clock& clock_;
  AuditLog audit_;
  InstalledStore installed_;
  PackStore packs_;
  IncomingPacks incoming_;
  TrustFile trust_;
  BaseMaps maps_;
  std::mutex mutex_;
  std::set<std::pair<std::string, Sha256>> busy_;  // packs that a call writes now
  std::map<std::int64_t, Unread> unevaluated_;     // by upload, while it is evaluated
  std::set<TileKey> unread_;                       // addresses whose images could not be read, since the last throw
  std::optional<Error> why_unread_;                // the first of them
  std::set<std::string> applied_revocations_;      // keys whose tiles the catalogue has withdrawn
  std::int64_t audited_root_ = 0;                  // version
  std::string audited_root_fault_;
  std::string unrecovered_;  // what recover() could not do
  CatalogueThread catalogue_;
};

}  // namespace nadir
