// Packs on their way into the service: parts come in, a whole pack is checked against its announcement, kept, and noted
// in the catalogue. A pack of which the last call was cut off is taken in by the next one that looks at it.
//
// For any number of threads; each pack has one writer at a time. A disk that is full is OutOfSpace, and costs nothing
// that was acknowledged.
#pragma once

#include <cstdint>
#include <mutex>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "base/bytes.hpp"
#include "base/time.hpp"
#include "candidates/audit_log.hpp"
#include "candidates/catalogue_thread.hpp"
#include "candidates/pack_store.hpp"
#include "candidates/upload_contract.hpp"

namespace nadir {

struct PackLimits {
  std::uint64_t keep_free_bytes = std::uint64_t{1} << 30;  // of the disk; below it nothing is taken
  std::size_t packs_at_once = 4;                           // unfinished ones of an upload
  // One that has not grown for so long makes room for another: a sender that rebuilds its packs never finishes the old
  // ones. Longer than a part may take on the slowest line that is waited for.
  std::int64_t pack_rest_s = 300;
};

class PackIntake {
 public:
  // folder: of the packs on their way. All references must outlive this.
  PackIntake(std::filesystem::path folder, PackStore& kept, CatalogueThread& catalogue, AuditLog& audit,
             const Clock& clock, const PackLimits& limits);

  // Each throws OutOfSpace, Error.
  Answer<PackOffset> offset(const UploadRow& upload, const Sha256& pack);
  // The offset after it.
  Answer<PackOffset> append(const UploadRow& upload, const Sha256& pack, const PartHeader& header, ByteView part);
  void accept_whole(const UploadRow& upload);  // those that are there and were not taken in

  void forget(const std::string& upload) { incoming_.remove_all_of(upload); }  // what came of its packs
  // After a start: accepts what is whole, removes what belongs to no upload and packs that the catalogue does not know.
  void recover(const std::vector<UploadRow>& uploads);

  std::optional<Denial> no_room(std::uint64_t bytes) const;

 private:
  class Claim;
  std::optional<Denial> accept(const UploadRow& upload, const IncomingPack& pack);
  bool evict_abandoned(const std::string& upload);

  IncomingPacks incoming_;
  PackStore& kept_;
  CatalogueThread& catalogue_;
  AuditLog& audit_;
  const Clock& clock_;
  const PackLimits limits_;
  std::mutex mutex_;
  std::set<std::pair<std::string, Sha256>> claimed_;  // packs that a call writes now
};

}  // namespace nadir
