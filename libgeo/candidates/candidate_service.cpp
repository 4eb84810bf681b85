#include "candidates/candidate_service.hpp"

#include <fmt/format.h>
#include <sys/random.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <nlohmann/json.hpp>
#include <utility>

#include "base/error.hpp"
#include "base/files.hpp"
#include "base/json.hpp"
#include "candidates/tile_check.hpp"
#include "candidates/vote.hpp"
#include "geodesy/web_mercator.hpp"
#include "upload/pack.hpp"

namespace nadir {
namespace {

using Kind = Denial::Kind;

// 128 bits of the operating system's randomness: uploads of others cannot be guessed.
std::string random_name() {
  std::array<std::uint8_t, 16> bytes{};
  if (::getrandom(bytes.data(), bytes.size(), 0) != static_cast<ssize_t>(bytes.size())) {
    throw Error({.what = "the operating system provides no randomness"});
  }
  std::string name;
  for (const std::uint8_t byte : bytes) name += fmt::format("{:02x}", byte);
  return name;
}

// One key for each batch of each client: what others announce under the same id is another thing.
Sha256 batch_key(const UploadClient& client, const std::string& batch) {
  return sha256(as_bytes(client.name + '\n' + batch));
}

// The finding that made the check fail, as a reason.
Refusal refusal_from(const Findings& findings) {
  const bool revoked = findings.contains("key.revoked");
  std::string detail;
  for (const Finding& finding : findings.items()) {
    if (finding.severity == Severity::error && detail.empty())
      detail = fmt::format("{}: {}", finding.code, finding.found);
  }
  return {.code = revoked ? ReasonCode::airframe_revoked : ReasonCode::batch_signature, .detail = std::move(detail)};
}

}  // namespace

bool UploadClient::may(std::string_view airframe) const {
  return airframes.empty() || std::find(airframes.begin(), airframes.end(), airframe) != airframes.end();
}

CandidateService::CandidateService(CandidateServiceOptions options, const Clock& clock)
    : options_(std::move(options)),
      clock_(clock),
      audit_(options_.data / "audit", clock),
      installed_(options_.data / "installed"),
      packs_(options_.data / "packs"),
      incoming_(options_.data / "incoming"),
      trust_(options_.trust, options_.data / kTrustMemoryFile, clock_),
      maps_(options_.packages, *trust_.current(), clock_.now()),
      catalogue_(options_.catalogue, CandidateCatalogue::Access::write) {}

ServiceFault CandidateService::fault() {
  try {
    catalogue_.call([](CandidateCatalogue& catalogue) { catalogue.probe(); });
  } catch (const Error& error) {
    return {.reason = "the catalogue does not respond: " + error.text().what, .fails = true};
  }
  if (trust_.current()->expires <= clock_.now()) return {.reason = "the trust root has expired", .fails = true};
  if (no_room(0)) return {.reason = "the disk is full", .fails = true};
  std::string reason = trust_.fault();
  if (reason.empty()) reason = audit_.fault();
  const std::lock_guard lock(mutex_);
  return {.reason = reason.empty() ? unrecovered_ : reason};
}

void CandidateService::keep_audit() {
  const auto root = trust_.current();
  const std::string fault = trust_.fault();
  const std::lock_guard lock(mutex_);
  if (root->version != audited_root_) {
    const bool first = audited_root_ == 0 && trust_.first_start();
    audit_.record({.act = "root.trust",
                   .result = first                ? "as given"
                             : audited_root_ == 0 ? "as remembered"
                                                  : "succeeded",
                   .subject = fmt::format("version {}", root->version),
                   .detail = first ? "no earlier root is remembered" : ""});
    audited_root_ = root->version;
  }
  if (fault != audited_root_fault_ && !fault.empty()) {
    audit_.record({.act = "root.trust", .result = "rejected", .detail = fault});
  }
  audited_root_fault_ = fault;
  audit_.flush();
}

CatalogueCounts CandidateService::counts() {
  return catalogue_.call([](CandidateCatalogue& catalogue) { return catalogue.counts(); });
}

std::optional<Denial> CandidateService::no_room(std::uint64_t bytes) const {
  if (packs_.free_bytes() >= options_.keep_free_bytes + bytes) return std::nullopt;
  return Denial{.kind = Kind::storage_full, .detail = "the service's disk is full; its operator must make room"};
}

std::vector<std::optional<Refusal>> CandidateService::check_batch(const SignedBatch& signed_batch, UtcTime now) {
  const Batch& batch = signed_batch.batch;
  std::vector<std::optional<Refusal>> refusals(batch.tiles.size());
  const auto all = [&refusals](Refusal refusal) {
    std::fill(refusals.begin(), refusals.end(), refusal);
    return refusals;
  };
  const auto root = trust_.current();
  if (const SignatureCheck check = check_batch_signature(*root, signed_batch, now); check.findings.has_errors()) {
    return all(refusal_from(check.findings));
  }
  if (batch.created_at.unix_s * 1000 > now.unix_s * 1000 + options_.rules.max_clock_error_ms) {
    return all({.code = ReasonCode::captured_in_future, .detail = "the batch's time is ahead of this clock"});
  }
  if (!maps_.takes(batch.base_package)) {
    return all({.code = ReasonCode::base_package_unknown, .detail = "this package was not given to the service"});
  }
  std::int64_t bytes = std::ssize(batch.tiles) * options_.rules.catalogue_bytes;
  for (const BatchTile& tile : batch.tiles) bytes += static_cast<std::int64_t>(tile.sidecar.size);
  const Usage usage = catalogue_.call([&](CandidateCatalogue& catalogue) {
    return catalogue.usage_of(batch.airframe, now.unix_s * 1000 - options_.rules.quota_window_ms);
  });
  const std::int64_t used = usage.bytes + usage.tiles * options_.rules.catalogue_bytes;
  if (used + bytes > options_.rules.quota_bytes) {
    return all(
        {.code = ReasonCode::quota,
         .detail = fmt::format("{} bytes recently, and {} more; at most {}", used, bytes, options_.rules.quota_bytes)});
  }
  for (std::size_t i = 0; i < refusals.size(); ++i) {
    const BatchTile& tile = batch.tiles[i];
    const SignatureCheck check =
        check_candidate_signature(*root, tile.sidecar, tile.sidecar_bytes, tile.signature, now);
    refusals[i] = check.findings.has_errors() ? std::optional(refusal_from(check.findings))
                                              : check_announced(tile.sidecar, batch.created_at, now, options_.rules);
  }
  return refusals;
}

Announcement CandidateService::announcement_of(const UploadRow& upload, bool opened) {
  Announcement announcement{.opened = opened, .upload = upload.name, .expires_ms = upload.expires_ms};
  const std::vector<TileRow> tiles = catalogue_.call([&upload](CandidateCatalogue& catalogue) {
    return catalogue.tiles_of(upload.id, CandidateCatalogue::Detail::verdicts);
  });
  for (const TileRow& tile : tiles) {
    if (tile.verdict == Verdict::rejected) {
      announcement.refused.emplace_back(tile.sha256, Refusal{tile.code.value_or(ReasonCode::policy), tile.detail});
    } else if (tile.blob || tile.verdict) {
      announcement.known.push_back(tile.sha256);
    } else {
      announcement.missing.push_back(tile.sha256);
    }
  }
  return announcement;
}

Answer<Announcement> CandidateService::announce(const UploadClient& client, const std::string& key,
                                                const std::string& body) {
  auto answer = announce_batch(client, key, body);
  if (const auto* denial = std::get_if<Denial>(&answer)) {
    audit_.record({.act = "batch.announce",
                   .result = "refused",
                   .token = client.token,
                   .client = client.name,
                   .subject = key,
                   .detail = denial->detail});
  }
  return answer;
}

Answer<Announcement> CandidateService::announce_batch(const UploadClient& client, const std::string& key,
                                                      const std::string& body) {
  if (!is_uuid(key)) return Denial{.kind = Kind::malformed, .detail = "Idempotency-Key: the batch's id, a UUID"};
  const UtcTime now = clock_.now();
  const std::int64_t now_ms = now.unix_s * 1000;
  const Sha256 known_as = batch_key(client, key), body_sha256 = sha256(as_bytes(body));
  auto known = catalogue_.call([&](CandidateCatalogue& catalogue) { return catalogue.upload_of_batch(known_as); });
  if (known && known->body_sha256 != body_sha256) {
    return Denial{.kind = Kind::key_reused, .detail = "this Idempotency-Key belongs to another batch"};
  }
  if (known && known->state == UploadState::open && known->expires_ms <= now_ms) {
    forget_expired();
    known.reset();
  }
  if (known) return announcement_of(*known, false);

  std::optional<SignedBatch> batch;
  try {
    parse_json(body, "the body");
  } catch (const Error& error) {
    return Denial{.kind = Kind::malformed, .detail = error.what()};
  }
  try {
    batch = parse_batch(body, "the batch");
  } catch (const Error& error) {
    return Denial{.kind = Kind::batch_invalid, .detail = error.what()};
  }
  if (batch->batch.id != key) {
    return Denial{.kind = Kind::batch_invalid, .detail = "the Idempotency-Key is not the batch's id"};
  }
  if (!client.may(batch->batch.airframe)) {
    return Denial{.kind = Kind::forbidden, .detail = "this token is not for airframe " + batch->batch.airframe};
  }
  if (auto full = no_room(0)) return *full;
  if (trust_.current()->expires <= now) {
    return Denial{.kind = Kind::unavailable,
                  .detail = "the trust root has expired; the service's operator must renew it"};
  }

  const std::vector<std::optional<Refusal>> refusals = check_batch(*batch, now);
  UploadRow upload{.name = random_name(),
                   .batch_key = known_as,
                   .batch = key,
                   .body_sha256 = body_sha256,
                   .client = client.name,
                   .airframe = batch->batch.airframe,
                   .flight = batch->batch.flight,
                   .base_package = batch->batch.base_package,
                   .opened_ms = now_ms,
                   .expires_ms = now_ms + options_.upload_life_ms};
  for (std::size_t i = 0; i < refusals.size(); ++i) {
    if (refusals[i]) continue;
    ++upload.tiles;
    upload.bytes += static_cast<std::int64_t>(batch->batch.tiles[i].sidecar.size);
  }
  if (upload.tiles == 0) {
    upload.state = UploadState::judged;
    const std::int64_t refused = catalogue_.call([&](CandidateCatalogue& catalogue) {
      return catalogue.refused_batches_of(client.name, now_ms - options_.rules.quota_window_ms);
    });
    if (refused >= options_.rules.refused_batches) {
      return Denial{
          .kind = Kind::too_many,
          .detail = "too many batches without an accepted tile; the first reason: " + refusals.front()->detail};
    }
  }
  const auto stored = catalogue_.call([&](CandidateCatalogue& catalogue) {
    return catalogue.upload(catalogue.open_upload(upload, batch->batch, refusals, now_ms));
  });
  const bool refused = upload.tiles == 0;
  audit_.record({.act = "batch.announce",
                 .result = refused ? std::string(name_of(refusals.front()->code)) : "opened",
                 .token = client.token,
                 .client = client.name,
                 .key = batch->document.signatures.front().keyid,
                 .subject = fmt::format("{} {} {}", upload.airframe, upload.flight, key),
                 .detail = fmt::format("tiles {} of {}", upload.tiles, refusals.size())});
  return announcement_of(*stored, stored->name == upload.name);
}

std::variant<UploadRow, Denial> CandidateService::find(const UploadClient& client, const std::string& name) {
  const auto digits = [](char c) { return (c >= '0' && c <= '9') || (c >= 'a' && c <= 'f'); };
  std::optional<UploadRow> upload;
  if (name.size() == 32 && std::all_of(name.begin(), name.end(), digits)) {
    upload = catalogue_.call([&name](CandidateCatalogue& catalogue) { return catalogue.upload_named(name); });
  }
  if (!upload) return Denial{.kind = Kind::not_found, .detail = "no such upload; announce the batch again"};
  if (upload->client != client.name) {
    return Denial{.kind = Kind::forbidden, .detail = "another token has opened this upload"};
  }
  if (upload->state == UploadState::open && upload->expires_ms <= clock_.now().unix_s * 1000) {
    return Denial{.kind = Kind::not_found, .detail = "the upload has expired; announce the batch again"};
  }
  return *std::move(upload);
}

Answer<UploadStatus> CandidateService::status(const UploadClient& client, const std::string& name) {
  auto found = find(client, name);
  if (auto* denial = std::get_if<Denial>(&found)) return *denial;
  auto& upload = std::get<UploadRow>(found);
  auto tiles = catalogue_.call([&upload](CandidateCatalogue& catalogue) {
    return catalogue.tiles_of(upload.id, CandidateCatalogue::Detail::verdicts);
  });
  return UploadStatus{.upload = std::move(upload), .tiles = std::move(tiles)};
}

// The candidate service's packs: parts come in, whole packs are checked and kept.

// Claims a pack for one call; false for the others.
class PackClaim {
 public:
  PackClaim(CandidateService& service, const std::string& upload, const Sha256& pack)
      : service_(service), key_(upload, pack) {
    const std::lock_guard lock(service_.mutex_);
    got_ = service_.busy_.insert(key_).second;
  }
  ~PackClaim() {
    if (!got_) return;
    const std::lock_guard lock(service_.mutex_);
    service_.busy_.erase(key_);
  }
  PackClaim(const PackClaim&) = delete;
  PackClaim& operator=(const PackClaim&) = delete;

  explicit operator bool() const { return got_; }

 private:
  CandidateService& service_;
  std::pair<std::string, Sha256> key_;
  bool got_ = false;
};

namespace {

using SizeByDigest = std::map<Sha256, std::uint64_t>;

// Throws Error for anything but a pack of announced tiles.
std::vector<CandidateCatalogue::PackedTile> tiles_in(ByteView bytes, const IncomingPack& pack,
                                                     const SizeByDigest& announced) {
  if (sha256(bytes) != pack.sha256) {
    throw Error({.what = "cannot accept this pack", .expected = pack.sha256.hex(), .found = sha256(bytes).hex()});
  }
  PackReader reader(
      pack.length,
      [&announced](const PackEntry& entry) {
        const auto found = announced.find(entry.sha256);
        return found != announced.end() && found->second == entry.size;
      },
      [](const PackEntry&, ByteView) {});
  reader.feed(bytes);
  reader.finish();
  std::vector<CandidateCatalogue::PackedTile> packed;
  std::uint64_t start = kPackHeadSize + reader.entries().size() * kPackEntrySize;
  for (const PackEntry& entry : reader.entries()) {
    packed.push_back({.sha256 = entry.sha256, .start = start, .bytes = entry.size});
    start += entry.size;
  }
  return packed;
}

}  // namespace

// Checks a whole pack and keeps it; or says why it is invalid and removes it.
std::optional<Denial> CandidateService::accept_pack(const UploadRow& upload, const IncomingPack& pack) {
  const std::vector<TileRow> tiles = catalogue_.call([&upload](CandidateCatalogue& catalogue) {
    return catalogue.tiles_of(upload.id, CandidateCatalogue::Detail::verdicts);
  });
  SizeByDigest announced;  // size by digest, of those that were not refused
  for (const TileRow& tile : tiles) {
    if (tile.verdict != Verdict::rejected) announced[tile.sha256] = tile.size;
  }
  std::vector<CandidateCatalogue::PackedTile> packed;
  const Bytes bytes = read_file(pack.path, kMaxPackSize);
  try {
    packed = tiles_in(bytes, pack, announced);
  } catch (const Error& error) {
    audit_.record({.act = "pack.take",
                   .result = "refused",
                   .client = upload.client,
                   .subject = fmt::format("{} {} {}", upload.airframe, upload.flight, upload.batch),
                   .detail = error.what()});
    incoming_.remove(pack);
    return Denial{.kind = Kind::pack_invalid, .detail = error.what()};
  }
  catalogue_.call([&](CandidateCatalogue& catalogue) {
    catalogue.add_pack(upload.id, pack.sha256, pack.length, packed, [&] { packs_.adopt(pack.path, pack.sha256); });
  });
  incoming_.remove(pack);
  return std::nullopt;
}

Answer<PackOffset> CandidateService::offset(const UploadClient& client, const std::string& name, const Sha256& sha256) {
  const auto found = find(client, name);
  if (const auto* denial = std::get_if<Denial>(&found)) return *denial;
  const auto& upload = std::get<UploadRow>(found);
  const auto size =
      catalogue_.call([&](CandidateCatalogue& catalogue) { return catalogue.pack_size(upload.id, sha256); });
  if (size) return PackOffset{.offset = *size, .length = *size};
  const PackClaim busy(*this, name, sha256);
  const auto pack = incoming_.find(name, sha256);
  if (pack && !pack->whole()) return PackOffset{.offset = pack->offset};
  if (pack && busy) {  // whole, but its last call was cut off before it was taken in
    if (auto denial = accept_pack(upload, *pack)) return *denial;
    return PackOffset{.offset = pack->length, .length = pack->length};
  }
  if (pack) return PackOffset{.offset = pack->offset};
  return Denial{.kind = Kind::pack_unknown, .detail = "no part of this pack has been received"};
}

// Removes the pack that has rested for longest; its sender would begin again. True: there is room.
bool CandidateService::evict_abandoned_pack(const std::string& upload) {
  std::optional<IncomingPack> oldest;
  for (IncomingPack& pack : incoming_.of(upload)) {
    if (!pack.whole() && (!oldest || pack.grown_s < oldest->grown_s)) oldest = std::move(pack);
  }
  if (!oldest || clock_.now().unix_s - oldest->grown_s < options_.pack_rest_s) return false;
  const PackClaim busy(*this, upload, oldest->sha256);
  if (busy) incoming_.remove(*oldest);
  return static_cast<bool>(busy);
}

Answer<PackOffset> CandidateService::append(const UploadClient& client, const std::string& name, const Sha256& sha256,
                                            const PartHeader& header, ByteView part) {
  const auto found = find(client, name);
  if (const auto* denial = std::get_if<Denial>(&found)) return *denial;
  const auto& upload = std::get<UploadRow>(found);
  if (nadir::sha256(part) != header.digest) {
    return Denial{.kind = Kind::digest_mismatch, .detail = "the part's SHA-256 does not match; the part was discarded"};
  }
  if (part.empty()) return Denial{.kind = Kind::malformed, .detail = "a part has at least one byte"};
  const auto size =
      catalogue_.call([&](CandidateCatalogue& catalogue) { return catalogue.pack_size(upload.id, sha256); });
  const auto elsewhere = [](std::uint64_t offset) {
    return Denial{.kind = Kind::offset_mismatch,
                  .detail = fmt::format("the pack continues at byte {}", offset),
                  .offset = offset};
  };
  if (size) return elsewhere(*size);
  const PackClaim busy(*this, name, sha256);
  auto pack = incoming_.find(name, sha256);
  if (!busy) {
    return Denial{
        .kind = Kind::pack_busy, .detail = "another call writes this pack", .offset = pack ? pack->offset : 0};
  }
  if (!pack) {
    if (header.offset != 0) return elsewhere(0);
    if (!header.length) return Denial{.kind = Kind::malformed, .detail = "Upload-Length: with a pack's first part"};
    if (*header.length > kMaxPackSize) {
      return Denial{.kind = Kind::too_large, .detail = fmt::format("packs have at most {} bytes", kMaxPackSize)};
    }
    if (upload.state != UploadState::open) {
      return Denial{.kind = Kind::pack_invalid, .detail = "the upload is complete; nothing is missing"};
    }
    if (incoming_.of(name).size() >= options_.packs_at_once && !evict_abandoned_pack(name)) {
      return Denial{.kind = Kind::too_many,
                    .detail = fmt::format("send at most {} packs at a time", options_.packs_at_once)};
    }
    pack = incoming_.begin(name, sha256, *header.length);
  }
  if (header.length && *header.length != pack->length) {
    return Denial{.kind = Kind::pack_invalid, .detail = fmt::format("Upload-Length was {} bytes before", pack->length)};
  }
  if (header.offset != pack->offset) return elsewhere(pack->offset);
  if (part.size() > pack->length - pack->offset) {
    return Denial{.kind = Kind::too_large, .detail = "the part goes beyond the pack's end"};
  }
  if (auto full = no_room(pack->length)) return *full;
  try {
    incoming_.append(*pack, part, clock_.now());
  } catch (const OutOfSpace&) {
    return Denial{.kind = Kind::storage_full, .detail = "the service's disk is full; its operator must make room"};
  }
  if (pack->whole()) {
    if (auto denial = accept_pack(upload, *pack)) return *denial;
    return PackOffset{.offset = pack->length, .length = pack->length};
  }
  return PackOffset{.offset = pack->offset};
}

Answer<InstalledStore::Outcome> CandidateService::report_installed(const UploadClient& client,
                                                                   const std::string& body) {
  AuditEntry entry{.act = "installed.report", .result = "refused", .token = client.token, .client = client.name};
  const auto denied = [&](Denial denial) {
    entry.detail = denial.detail;
    audit_.record(entry);
    return denial;
  };
  std::optional<SignedInstalledReport> report;
  try {
    parse_json(body, "the body");
  } catch (const Error& error) {
    return denied({.kind = Kind::malformed, .detail = error.what()});
  }
  try {
    report = parse_installed_report(body, "the report");
  } catch (const Error& error) {
    return denied({.kind = Kind::report_invalid, .detail = error.what()});
  }
  const InstalledReport& said = report->report;
  entry.key = report->document.signatures.front().keyid;
  entry.subject = fmt::format("{} number {}", said.airframe, said.number);
  if (!client.may(said.airframe)) {
    return denied({.kind = Kind::forbidden, .detail = "this token is not for airframe " + said.airframe});
  }
  const auto root = trust_.current();
  const UtcTime now = clock_.now();
  if (const SignatureCheck check = check_installed_signature(*root, *report, now); check.findings.has_errors()) {
    return denied({.kind = Kind::report_invalid, .detail = refusal_from(check.findings).detail});
  }
  InstalledStore::Outcome outcome{};
  try {
    outcome = installed_.put(*report, *root, now);
  } catch (const OutOfSpace&) {
    return denied({.kind = Kind::storage_full, .detail = "the service's disk is full; its operator must make room"});
  }
  if (outcome == InstalledStore::Outcome::older) {
    return denied({.kind = Kind::report_older, .detail = "a later report of this airframe is known"});
  }
  if (outcome == InstalledStore::Outcome::known) return outcome;
  entry.result = "stored";
  entry.detail = fmt::format("package {} ({} {}), root version {}", said.package.hex(), said.series, said.sequence,
                             said.root_version);
  audit_.record(entry);
  return outcome;
}

void CandidateService::recover() {
  const auto attempt = [this](const char* what, const auto& work) {
    try {
      work();
    } catch (const std::exception& error) {
      const std::lock_guard lock(mutex_);
      if (unrecovered_.empty()) {
        unrecovered_ =
            fmt::format("{} at the start: {}; nothing was lost, the next start tries it again", what, error.what());
      }
    }
  };
  keep_audit();
  attempt("expired uploads were not removed", [this] { forget_expired(); });
  attempt("revocations were not applied", [this] { apply_revocations(); });
  attempt("complete packs were not taken in", [this] { recover_packs(); });
}

void CandidateService::recover_packs() {
  const auto uploads = catalogue_.call([](CandidateCatalogue& catalogue) {
    std::vector<UploadRow> all = catalogue.uploads_in(UploadState::open);
    const std::vector<UploadRow> judging = catalogue.uploads_in(UploadState::judging);
    all.insert(all.end(), judging.begin(), judging.end());
    return all;
  });
  std::set<std::string> names;
  for (const UploadRow& upload : uploads) {
    names.insert(upload.name);
    for (const IncomingPack& pack : incoming_.of(upload.name)) {
      if (pack.whole()) accept_pack(upload, pack);
    }
  }
  for (const std::string& name : incoming_.uploads()) {
    if (!names.contains(name)) incoming_.remove_all_of(name);
  }
  const std::set<Sha256> known = catalogue_.call([](CandidateCatalogue& catalogue) { return catalogue.packs(); });
  for (const Sha256& pack : packs_.packs()) {
    if (!known.contains(pack)) packs_.remove(pack);
  }
}

void CandidateService::forget_expired() {
  const std::int64_t now_ms = clock_.now().unix_s * 1000;
  const auto gone = catalogue_.call([this, now_ms](CandidateCatalogue& catalogue) {
    std::vector<std::string> forgotten;
    for (const UploadRow& upload : catalogue.uploads_in(UploadState::open)) {
      if (upload.expires_ms > now_ms) continue;
      catalogue.remove_unused(catalogue.forget_upload(upload.id), [this](const Sha256& pack) { packs_.remove(pack); });
      forgotten.push_back(upload.name);
    }
    return forgotten;
  });
  for (const std::string& name : gone) incoming_.remove_all_of(name);
}

// The candidate service's judgement: verdicts on tiles, votes between flights.

namespace {

constexpr std::size_t kTilesAtOnce = 128;  // other callers come in between
constexpr const char* kDamagedHere = "the service's copy of this tile is damaged; send it again";

double pixel_mm(const TileKey& key) {
  const LonLatBox box = bounds_of(key);
  return ground_resolution_m(key.z, (box.south_deg + box.north_deg) / 2) * 1000;
}

}  // namespace

Answer<Completion> CandidateService::complete(const UploadClient& client, const std::string& name,
                                              std::optional<std::int64_t>& evaluate) {
  auto found = find(client, name);
  if (auto* denial = std::get_if<Denial>(&found)) return *denial;
  const auto& upload = std::get<UploadRow>(found);
  for (const IncomingPack& pack : incoming_.of(name)) {
    if (pack.whole()) offset(client, name, pack.sha256);  // takes it in
  }
  const std::vector<TileRow> tiles = catalogue_.call([&upload](CandidateCatalogue& catalogue) {
    return catalogue.tiles_of(upload.id, CandidateCatalogue::Detail::verdicts);
  });
  Completion completion{.upload = name};
  Denial missing{.kind = Denial::Kind::incomplete, .detail = {}};
  for (const TileRow& tile : tiles) {
    if (tile.verdict) continue;
    ++completion.pending;
    if (!tile.blob) missing.missing.push_back(tile.sha256);
  }
  if (!missing.missing.empty()) {
    missing.detail = fmt::format("tiles are missing: {}", missing.missing.size());
    return missing;
  }
  if (upload.state == UploadState::open) {
    catalogue_.call([&upload](CandidateCatalogue& catalogue) { catalogue.set_state(upload.id, UploadState::judging); });
    audit_.record({.act = "upload.complete",
                   .result = "taken",
                   .token = client.token,
                   .client = client.name,
                   .subject = fmt::format("{} {} {}", upload.airframe, upload.flight, upload.batch),
                   .detail = fmt::format("tiles {}", completion.pending)});
    incoming_.remove_all_of(name);
    evaluate = upload.id;
  }
  return completion;
}

// By the tile alone: its bytes, its image, and the map that its flight was matched with.
TileVerdict CandidateService::evaluate_tile(const TileRow& tile, const CandidateSidecar& sidecar) {
  TileVerdict verdict{.tile = tile.id};
  const auto rejected = [&verdict](Refusal refusal) {
    verdict.verdict = Verdict::rejected;
    verdict.refusal = std::move(refusal);
    return verdict;
  };
  if (tile.blob->bytes != sidecar.size) {
    return rejected({.code = ReasonCode::hash_mismatch, .detail = "the existing bytes have a different size"});
  }
  const auto read = read_candidate_image(packs_.read(*tile.blob, sidecar.sha256), sidecar);
  if (const auto* refusal = std::get_if<Refusal>(&read)) return rejected(*refusal);
  const auto& image = std::get<cv::Mat>(read);
  const ImageMetrics metrics = image_metrics(image);
  verdict.measures = OwnMeasures{.contrast_ppm = metrics.contrast_ppm, .sharpness_ppm = metrics.sharpness_ppm};
  if (const auto refusal = check_image_metrics(metrics, options_.rules)) return rejected(*refusal);

  const auto base = maps_.tile(sidecar.base_package, sidecar.key);
  if (!base) return verdict;
  const Agreement agreement = compare_images(image, base->grey);
  const auto shift_mm = std::llround(agreement.shift_px * pixel_mm(sidecar.key));
  verdict.measures->base_shift_mm = shift_mm;
  verdict.measures->correlation_ppm = std::llround(agreement.correlation * 1e6);
  if (*verdict.measures->correlation_ppm < options_.rules.min_correlation_ppm)
    return verdict;  // the ground may have changed
  const std::int64_t allowed_mm = allowed_shift_mm(static_cast<double>(sidecar.pose.sigma_mm),
                                                   static_cast<double>(base->ce90_mm) / kCe90OverSigma, options_.rules);
  if (shift_mm > allowed_mm) {
    return rejected({.code = ReasonCode::misaligned,
                     .detail = fmt::format("{} mm off the base package's map; at most {}", shift_mm, allowed_mm)});
  }
  return verdict;
}

std::vector<std::pair<std::string, std::int64_t>> CandidateService::pending_evaluations() {
  std::vector<std::pair<std::string, std::int64_t>> list;
  for (const UploadRow& upload :
       catalogue_.call([](CandidateCatalogue& catalogue) { return catalogue.uploads_in(UploadState::judging); })) {
    list.emplace_back(upload.client, upload.id);
  }
  return list;
}

// Nothing: it cannot be read now. The other tiles get their verdicts.
std::optional<CandidateCatalogue::Question> CandidateService::evaluate(const TileRow& tile, std::int64_t upload) {
  CandidateCatalogue::Question question{.verdict = {.tile = tile.id},
                                        .sidecar = parse_candidate(tile.sidecar, "the catalogue's sidecar"),
                                        .keyid = tile.keyid};
  const auto note = [this, upload](const Error& error) -> Unread& {
    Unread& unread = unevaluated_[upload];
    if (!unread.why) unread.why = error;
    return unread;
  };
  try {
    question.verdict = evaluate_tile(tile, question.sidecar);
  } catch (const PackDamaged& error) {
    const std::lock_guard lock(mutex_);
    note(error);
    question.damaged = true;
    question.verdict.verdict = Verdict::rejected;
    question.verdict.refusal = Refusal{.code = ReasonCode::hash_mismatch, .detail = kDamagedHere};
  } catch (const Error& error) {
    const std::lock_guard lock(mutex_);
    note(error).tiles.insert(tile.id);
    return std::nullopt;
  }
  return question;
}

// Throws what kept tiles from being read.
void CandidateService::end_evaluation(std::int64_t upload) {
  const std::lock_guard lock(mutex_);
  const auto unread = unevaluated_.extract(upload);
  if (unread && unread.mapped().why) throw Error(*unread.mapped().why);
}

bool CandidateService::evaluate_some(std::int64_t id) {
  const auto unread = [this, id] {
    const std::lock_guard lock(mutex_);
    const auto found = unevaluated_.find(id);
    return found == unevaluated_.end() ? std::set<std::int64_t>() : found->second.tiles;
  };
  const std::set<std::int64_t> waiting = unread();
  const std::vector<TileRow> tiles = catalogue_.call(
      [&](CandidateCatalogue& catalogue) { return catalogue.tiles_to_judge(id, kTilesAtOnce, waiting); });
  std::vector<CandidateCatalogue::Question> questions;
  for (const TileRow& tile : tiles) {
    if (auto question = evaluate(tile, id)) questions.push_back(std::move(*question));
  }
  const bool last = tiles.size() < kTilesAtOnce;
  const bool done = last && unread().empty();
  const std::int64_t now_ms = clock_.now().unix_s * 1000;
  catalogue_.call([&](CandidateCatalogue& catalogue) {
    // In this thread, in turn with apply_revocations(): a key that is revoked meanwhile is seen by one of the two.
    const auto root = trust_.current();
    for (CandidateCatalogue::Question& question : questions) {
      if (!root->revoked.contains(question.keyid)) continue;
      question.verdict = {.tile = question.verdict.tile,
                          .verdict = Verdict::rejected,
                          .refusal = Refusal{.code = ReasonCode::airframe_revoked, .detail = kRevokedLater}};
    }
    catalogue.add_evaluated(
        std::move(questions), now_ms,
        [](TileVerdict& verdict, const CandidateSidecar& sidecar, const CandidateCatalogue::Competitors& rivals) {
          if (verdict.verdict != Verdict::accepted) return;
          if (rivals.same_bytes) {
            verdict.verdict = Verdict::duplicate;
            verdict.detail = "this tile was already accepted";
          } else if (rivals.of_flight_mm && static_cast<double>(*rivals.of_flight_mm) <= cost_mm(sidecar)) {
            verdict.verdict = Verdict::rejected;
            verdict.refusal = Refusal{.code = ReasonCode::better_tile_exists,
                                      .detail = "this flight has sent a better tile of this address"};
          }
        });
    if (!done) return;
    catalogue.set_state(id, UploadState::judged);
    catalogue.remove_unused(catalogue.forget_dead_packs(id), [this](const Sha256& pack) { packs_.remove(pack); });
  });
  if (last) end_evaluation(id);
  return !last;
}

std::int64_t CandidateService::apply_revocations() {
  const std::set<std::string> revoked = trust_.current()->revoked;
  {
    const std::lock_guard lock(mutex_);
    if (revoked == applied_revocations_) return 0;
  }
  const std::int64_t withdrawn =
      catalogue_.call([&revoked](CandidateCatalogue& catalogue) { return catalogue.withdraw(revoked); });
  if (withdrawn > 0) {
    audit_.record({.act = "tiles.withdraw",
                   .result = "withdrawn",
                   .subject = fmt::format("tiles {}", withdrawn),
                   .detail = fmt::format("signed by keys that root version {} revokes", trust_.current()->version)});
  }
  const std::lock_guard lock(mutex_);
  applied_revocations_ = revoked;
  return withdrawn;
}

Vote CandidateService::compare(const AcceptedCandidate& one, const AcceptedCandidate& other) {
  const auto image = [this](const AcceptedCandidate& candidate) {
    return read_candidate_image(packs_.read(candidate.blob, candidate.sidecar.sha256), candidate.sidecar);
  };
  Vote vote{.allowed_mm = allowed_shift_mm(static_cast<double>(one.sidecar.pose.sigma_mm),
                                           static_cast<double>(other.sidecar.pose.sigma_mm), options_.rules)};
  const auto first = image(one), second = image(other);
  if (!std::holds_alternative<cv::Mat>(first) || !std::holds_alternative<cv::Mat>(second)) return vote;
  const Agreement agreement = compare_images(std::get<cv::Mat>(first), std::get<cv::Mat>(second));
  vote.shift_mm = std::llround(agreement.shift_px * pixel_mm(one.sidecar.key));
  vote.correlation_ppm = std::llround(agreement.correlation * 1e6);
  vote.agrees = vote.correlation_ppm >= options_.rules.min_correlation_ppm && vote.shift_mm <= vote.allowed_mm;
  return vote;
}

bool CandidateService::vote_some() {
  const std::set<TileKey> unread = [this] {
    const std::lock_guard lock(mutex_);
    return unread_;
  }();
  const std::vector<AddressCandidates> addresses = catalogue_.call(
      [&unread](CandidateCatalogue& catalogue) { return catalogue.open_addresses(kTilesAtOnce, unread); });
  if (addresses.empty()) {
    const std::lock_guard lock(mutex_);
    unread_.clear();
    if (const auto why = std::exchange(why_unread_, std::nullopt)) throw Error(*why);
    return false;
  }
  const std::int64_t now_ms = clock_.now().unix_s * 1000;
  std::vector<AddressCandidates> decided;
  std::vector<Outcome> outcomes;
  for (const AddressCandidates& address : addresses) {
    try {
      outcomes.push_back(decide(
          address, [this](const AcceptedCandidate& one, const AcceptedCandidate& other) { return compare(one, other); },
          now_ms, options_.rules));
      decided.push_back(address);
    } catch (const Error& error) {  // a pack is damaged: that keeps no other address from its vote
      const std::lock_guard lock(mutex_);
      unread_.insert(address.key);
      if (!why_unread_) why_unread_ = error;
    }
  }
  catalogue_.call([&](CandidateCatalogue& catalogue) { catalogue.close(decided, outcomes); });
  const auto promoted = std::count_if(outcomes.begin(), outcomes.end(),
                                      [](const Outcome& outcome) { return outcome.promotion.has_value(); });
  if (promoted > 0) {
    audit_.record({.act = "tiles.promote",
                   .result = "promoted",
                   .subject = fmt::format("tiles {}", promoted),
                   .detail = fmt::format("{} flights, independent by {}", options_.rules.flights_to_promote,
                                         options_.rules.airframes_differ ? "airframes" : "days")});
  }
  return true;
}

}  // namespace nadir
