// The candidate service without its HTTP: announcements of batches, and who may do what. It hands packs to their intake
// (pack_intake.hpp) and complete uploads to their evaluation (tile_evaluation.hpp). For any number of threads.
//
// What a caller was answered is on the disk. A killed process resumes where it was: recover() completes what was begun,
// and every call may be repeated. A disk that is full is an answer (storage_full), and nothing acknowledged is lost.
#pragma once

#include <cstdint>
#include <filesystem>
#include <mutex>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <variant>
#include <vector>

#include "base/time.hpp"
#include "candidates/audit_log.hpp"
#include "candidates/base_maps.hpp"
#include "candidates/candidate_rules.hpp"
#include "candidates/catalogue_thread.hpp"
#include "candidates/installed_store.hpp"
#include "candidates/pack_intake.hpp"
#include "candidates/pack_store.hpp"
#include "candidates/tile_evaluation.hpp"
#include "candidates/trust_file.hpp"
#include "candidates/upload_contract.hpp"

namespace nadir {

// What impairs the service; an empty reason: nothing. fails: it takes no uploads.
struct ServiceFault {
  std::string reason;
  bool fails = false;
};

struct CandidateServiceOptions {
  std::filesystem::path data;  // packs/, incoming/, installed/, audit/ and the memory of the trust root
  CatalogueLocation catalogue;
  std::filesystem::path trust;
  std::vector<std::filesystem::path> packages;
  CandidateRules rules{};
  std::uint64_t part_max = std::uint64_t{1} << 20;
  PackLimits packs{};
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
  // Now and then: what recover() could not do.
  void retry_recovery();

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

  // Pieces of work (tile_evaluation.hpp).
  std::vector<std::pair<std::string, std::int64_t>> pending_evaluations() { return evaluation_.pending(catalogue_); }
  bool evaluate_some(std::int64_t upload) { return evaluation_.evaluate_some(catalogue_, upload).more; }
  bool vote_some() { return evaluation_.vote_some(catalogue_).more; }
  std::int64_t apply_revocations() { return evaluation_.apply_revocations(catalogue_); }
  // Who does it: threads of this process (evaluation_workers.hpp).
  TileEvaluation& evaluation() { return evaluation_; }
  CatalogueThread& catalogue() { return catalogue_; }

  void forget_expired();
  // Now and then: writes to the audit log what has changed by itself, such as the trust root's version.
  void keep_audit();

  CatalogueCounts counts();
  ServiceFault fault();
  std::string root_fault() { return trust_.fault(); }  // why the trust root's file is rejected; empty: it is not
  std::int64_t root_version() { return trust_.current()->version; }
  std::set<Sha256> base_packages() const { return maps_.packages(); }
  bool first_trust() const { return trust_.first_start(); }
  AuditLog& audit() { return audit_; }
  UtcTime now() const { return clock_.now(); }
  const CandidateServiceOptions& options() const { return options_; }

 private:
  std::variant<UploadRow, Denial> find(const UploadClient& client, const std::string& upload);
  Answer<Announcement> announce_batch(const UploadClient& client, const std::string& key, const std::string& body);
  Announcement announcement_of(const UploadRow& upload, bool opened);
  std::vector<std::optional<Refusal>> check_batch(const SignedBatch& batch, UtcTime now);
  Answer<Completion> take_complete(const UploadClient& client, const std::string& upload,
                                   std::optional<std::int64_t>& evaluate);
  std::vector<UploadRow> unfinished_uploads();

  CandidateServiceOptions options_;
  const Clock& clock_;
  AuditLog audit_;
  InstalledStore installed_;
  PackStore packs_;
  TrustFile trust_;
  BaseMaps maps_;
  CatalogueThread catalogue_;
  PackIntake intake_;
  TileEvaluation evaluation_;
  std::mutex mutex_;
  std::int64_t audited_root_ = 0;  // version
  std::string audited_root_fault_;
  std::string unrecovered_;  // what recover() could not do
};

}  // namespace nadir
