#include "candidates/candidate_service.hpp"

#include <fmt/format.h>
#include <sys/random.h>

#include <algorithm>
#include <nlohmann/json.hpp>

#include "base/error.hpp"
#include "base/json.hpp"
#include "candidates/announced_tile.hpp"

namespace nadir {
namespace {

using Kind = Denial::Kind;

// 128 bits of the operating system's randomness: nobody guesses another's upload.
std::string random_name() {
  std::array<std::uint8_t, 16> bytes{};
  if (::getrandom(bytes.data(), bytes.size(), 0) != static_cast<ssize_t>(bytes.size())) {
    throw Error({.what = "the operating system gives no randomness"});
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
    if (finding.severity == Severity::refuse && detail.empty())
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
      packs_(options_.data / "packs"),
      incoming_(options_.data / "incoming"),
      trust_(options_.trust),
      maps_(options_.packages),
      catalogue_(options_.catalogue, CandidateCatalogue::Access::write) {}

ServiceTrouble CandidateService::trouble() {
  try {
    catalogue_.call([](CandidateCatalogue& catalogue) { catalogue.probe(); });
  } catch (const Error& error) {
    return {.reason = "the catalogue does not answer: " + error.text().what, .fails = true};
  }
  if (trust_.current()->expires <= clock_.now()) return {.reason = "the trust root has expired", .fails = true};
  if (no_room(0)) return {.reason = "the disk is full", .fails = true};
  return {.reason = trust_.trouble()};
}

CatalogueCounts CandidateService::counts() {
  return catalogue_.call([](CandidateCatalogue& catalogue) { return catalogue.counts(); });
}

std::optional<Denial> CandidateService::no_room(std::uint64_t bytes) const {
  if (packs_.free_bytes() >= options_.keep_free_bytes + bytes) return std::nullopt;
  return Denial{.kind = Kind::storage_full, .detail = "the service's disk is full; its operator must make room"};
}

std::vector<std::optional<Refusal>> CandidateService::refusals_of(const SignedBatch& signed_batch, UtcTime now) {
  const Batch& batch = signed_batch.batch;
  std::vector<std::optional<Refusal>> refusals(batch.tiles.size());
  const auto all = [&refusals](Refusal refusal) {
    std::fill(refusals.begin(), refusals.end(), refusal);
    return refusals;
  };
  const auto root = trust_.current();
  if (const SignatureCheck check = check_batch_signature(*root, signed_batch, now); check.findings.refuses()) {
    return all(refusal_from(check.findings));
  }
  if (batch.created_at.unix_s * 1000 > now.unix_s * 1000 + options_.rules.max_clock_error_ms) {
    return all({.code = ReasonCode::captured_in_future, .detail = "the batch was made ahead of this clock"});
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
         .detail = fmt::format("{} bytes lately, and {} more; at most {}", used, bytes, options_.rules.quota_bytes)});
  }
  for (std::size_t i = 0; i < refusals.size(); ++i) {
    const BatchTile& tile = batch.tiles[i];
    const SignatureCheck check =
        check_candidate_signature(*root, tile.sidecar, tile.sidecar_bytes, tile.signature, now);
    refusals[i] = check.findings.refuses() ? std::optional(refusal_from(check.findings))
                                           : judge_announced(tile.sidecar, batch.created_at, now, options_.rules);
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

  const std::vector<std::optional<Refusal>> refusals = refusals_of(*batch, now);
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
      return Denial{.kind = Kind::too_many,
                    .detail = "too many batches of which no tile is taken; the first is: " + refusals.front()->detail};
    }
  }
  const auto stored = catalogue_.call([&](CandidateCatalogue& catalogue) {
    return catalogue.upload(catalogue.open_upload(upload, batch->batch, refusals, now_ms));
  });
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

}  // namespace nadir
