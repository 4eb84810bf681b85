#include "candidates/candidate_service.hpp"

#include <fmt/format.h>
#include <sys/random.h>

#include <algorithm>
#include <array>
#include <nlohmann/json.hpp>
#include <set>
#include <type_traits>
#include <utility>

#include "base/error.hpp"
#include "base/files.hpp"
#include "base/json.hpp"
#include "candidates/tile_check.hpp"

namespace nadir {
namespace {

using Kind = Denial::Kind;

// 128 bits of the operating system's randomness: uploads of others cannot be guessed.
std::string random_name() {
  std::array<std::uint8_t, 16> bytes{};
  if (::getrandom(bytes.data(), bytes.size(), 0) != static_cast<ssize_t>(bytes.size())) {
    throw Error({.what = "the operating system provides no randomness for the name of an upload"});
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

template <typename Call>
std::invoke_result_t<Call> while_there_is_room(Call call) {
  try {
    return call();
  } catch (const OutOfSpace&) {
    return disk_full();
  }
}

}  // namespace

CandidateService::CandidateService(CandidateServiceOptions options, const Clock& clock)
    : options_(std::move(options)),
      clock_(clock),
      audit_(options_.data / "audit", clock),
      installed_(options_.data / "installed"),
      packs_(options_.data / "packs"),
      trust_(options_.trust, options_.data / kTrustMemoryFile, clock_),
      maps_(options_.packages, *trust_.current(), clock_.now()),
      catalogue_(options_.catalogue, CandidateCatalogue::Access::write),
      intake_(options_.data / "incoming", packs_, catalogue_, audit_, clock_, options_.packs),
      evaluation_(
          packs_, maps_, [this] { return trust_.current(); }, audit_, clock_, options_.rules) {}

ServiceFault CandidateService::fault() {
  try {
    catalogue_.call([](CandidateCatalogue& catalogue) { catalogue.probe(); });
  } catch (const Error& error) {
    return {.reason = "the catalogue does not respond: " + error.text().what, .fails = true};
  }
  if (trust_.current()->expires <= clock_.now())
    return {.reason = "the trust root has expired: put its next version in its place", .fails = true};
  try {
    if (intake_.no_room(0)) return {.reason = "the disk is full: make room", .fails = true};
  } catch (const Error& error) {
    return {.reason = error.what(), .fails = true};
  }
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
    return all({.code = ReasonCode::captured_in_future,
                .detail = fmt::format("the batch was created {} s ahead of the service's clock; at most {}",
                                      batch.created_at.unix_s - now.unix_s, options_.rules.max_clock_error_ms / 1000)});
  }
  if (!maps_.takes(batch.base_package)) {
    return all({.code = ReasonCode::base_package_unknown,
                .detail = fmt::format("package {} is none of the service's base packages", batch.base_package.hex())});
  }
  std::int64_t bytes = std::ssize(batch.tiles) * options_.rules.catalogue_bytes;
  for (const BatchTile& tile : batch.tiles) bytes += static_cast<std::int64_t>(tile.sidecar.size);
  const Usage usage = catalogue_.call([&](CandidateCatalogue& catalogue) {
    return catalogue.usage_of(batch.airframe, now.unix_s * 1000 - options_.rules.quota_window_ms);
  });
  const std::int64_t used = usage.bytes + usage.tiles * options_.rules.catalogue_bytes;
  if (used + bytes > options_.rules.quota_bytes) {
    return all({.code = ReasonCode::quota,
                .detail = fmt::format("{} bytes announced in the last 24 hours, and {} now; at most {}", used, bytes,
                                      options_.rules.quota_bytes)});
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
  auto answer = while_there_is_room([&] { return announce_batch(client, key, body); });
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
  if (!is_uuid(key)) return Denial{.kind = Kind::malformed, .detail = "send Idempotency-Key: the batch's id, a UUID"};
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
    batch = parse_batch(body, "the batch");
  } catch (const Error& error) {
    try {
      parse_json(body, "the body");
    } catch (const Error& syntax) {
      return Denial{.kind = Kind::malformed, .detail = syntax.what()};
    }
    return Denial{.kind = Kind::batch_invalid, .detail = error.what()};
  }
  if (batch->batch.id != key) {
    return Denial{.kind = Kind::batch_invalid,
                  .detail = "the Idempotency-Key must be the batch's id, " + batch->batch.id};
  }
  if (!client.may(batch->batch.airframe)) {
    return Denial{.kind = Kind::forbidden, .detail = "this token is not for airframe " + batch->batch.airframe};
  }
  if (auto full = intake_.no_room(0)) return *full;
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
    return Denial{.kind = Kind::forbidden, .detail = "another client has opened this upload"};
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

Answer<PackOffset> CandidateService::offset(const UploadClient& client, const std::string& name, const Sha256& pack) {
  return while_there_is_room([&]() -> Answer<PackOffset> {
    const auto upload = find(client, name);
    if (const auto* denial = std::get_if<Denial>(&upload)) return *denial;
    return intake_.offset(std::get<UploadRow>(upload), pack);
  });
}

Answer<PackOffset> CandidateService::append(const UploadClient& client, const std::string& name, const Sha256& pack,
                                            const PartHeader& header, ByteView part) {
  return while_there_is_room([&]() -> Answer<PackOffset> {
    const auto upload = find(client, name);
    if (const auto* denial = std::get_if<Denial>(&upload)) return *denial;
    return intake_.append(std::get<UploadRow>(upload), pack, header, part);
  });
}

Answer<Completion> CandidateService::complete(const UploadClient& client, const std::string& name,
                                              std::optional<std::int64_t>& evaluate) {
  return while_there_is_room([&] { return take_complete(client, name, evaluate); });
}

Answer<Completion> CandidateService::take_complete(const UploadClient& client, const std::string& name,
                                                   std::optional<std::int64_t>& evaluate) {
  auto found = find(client, name);
  if (auto* denial = std::get_if<Denial>(&found)) return *denial;
  const auto& upload = std::get<UploadRow>(found);
  intake_.accept_whole(upload);
  const std::vector<TileRow> tiles = catalogue_.call([&upload](CandidateCatalogue& catalogue) {
    return catalogue.tiles_of(upload.id, CandidateCatalogue::Detail::verdicts);
  });
  Completion completion{.upload = name};
  Denial missing{.kind = Kind::incomplete, .detail = {}};
  for (const TileRow& tile : tiles) {
    if (tile.verdict) continue;
    ++completion.pending;
    if (!tile.blob) missing.missing.push_back(tile.sha256);
  }
  if (!missing.missing.empty()) {
    missing.detail = fmt::format("tiles that have not arrived: {}; send them first", missing.missing.size());
    return missing;
  }
  if (upload.state == UploadState::open) {
    catalogue_.call([&upload](CandidateCatalogue& catalogue) { catalogue.start_judging(upload.id); });
    audit_.record({.act = "upload.complete",
                   .result = "taken",
                   .token = client.token,
                   .client = client.name,
                   .subject = fmt::format("{} {} {}", upload.airframe, upload.flight, upload.batch),
                   .detail = fmt::format("tiles {}", completion.pending)});
    intake_.forget(name);
    evaluate = upload.id;
  }
  return completion;
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
    return denied(disk_full());
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
        unrecovered_ = fmt::format("{} at the start: {}; nothing was lost, and it is tried again", what, error.what());
      }
    }
  };
  keep_audit();
  attempt("expired uploads were not removed", [this] { forget_expired(); });
  attempt("revocations were not applied", [this] { apply_revocations(); });
  attempt("complete packs were not taken in", [this] { intake_.recover(unfinished_uploads()); });
}

// But for what only a start may remove: now calls put files where it looks.
void CandidateService::retry_recovery() {
  {
    const std::lock_guard lock(mutex_);
    if (unrecovered_.empty()) return;
  }
  try {
    forget_expired();
    apply_revocations();
    for (const UploadRow& upload : unfinished_uploads()) intake_.accept_whole(upload);
    const std::lock_guard lock(mutex_);
    unrecovered_.clear();
  } catch (const std::exception&) {  // still; fault() says what
  }
}

std::vector<UploadRow> CandidateService::unfinished_uploads() {
  return catalogue_.call([](CandidateCatalogue& catalogue) {
    std::vector<UploadRow> uploads = catalogue.uploads_in(UploadState::open);
    const std::vector<UploadRow> judging = catalogue.uploads_in(UploadState::judging);
    uploads.insert(uploads.end(), judging.begin(), judging.end());
    return uploads;
  });
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
  for (const std::string& name : gone) intake_.forget(name);
}

}  // namespace nadir
