#include "candidates/upload_json.hpp"

#include <algorithm>
#include <nlohmann/json.hpp>

#include "base/printable.hpp"

namespace nadir {
namespace {

using nlohmann::json;
using Kind = Denial::Kind;

constexpr std::size_t kLongestDetail = 500;
constexpr const char* kSoon_s = "2";

ApiResponse json_answer(int status, const json& document) {
  return {.status = status, .body = document.dump(-1, ' ', false, json::error_handler_t::replace)};
}

std::string short_detail(const std::string& text) {
  std::string detail = printable(text);
  if (detail.size() > kLongestDetail) detail.resize(kLongestDetail);
  return detail;
}

json digests(const std::vector<Sha256>& list) {
  json array = json::array();
  for (const Sha256& sha256 : list) array.push_back(sha256.hex());
  return array;
}

std::string time_text(std::int64_t ms) { return to_rfc3339(UtcTime{ms / 1000}); }

const char* name_of(UploadState state) {
  switch (state) {
    case UploadState::open: return "open";
    case UploadState::judging: return "judging";
    case UploadState::judged: break;
  }
  return "judged";
}

const char* verdict_of(const TileRow& tile) {
  if (!tile.verdict) return "pending";
  switch (*tile.verdict) {
    case Verdict::accepted: return "accepted";
    case Verdict::rejected: return "rejected";
    case Verdict::duplicate: break;
  }
  return "duplicate";
}

struct Shown {
  int status;
  const char* type;
};

Shown shown(Kind kind) {
  switch (kind) {
    case Kind::malformed: return {400, "malformed"};
    case Kind::forbidden: return {403, "forbidden"};
    case Kind::not_found: return {404, "not-found"};
    case Kind::key_reused: return {422, "key-reused"};
    case Kind::batch_invalid: return {422, "batch-invalid"};
    case Kind::pack_unknown: return {404, "pack-unknown"};
    case Kind::pack_invalid: return {422, "pack-invalid"};
    case Kind::pack_busy: return {409, "pack-busy"};
    case Kind::offset_mismatch: return {409, "offset-mismatch"};
    case Kind::digest_mismatch: return {460, "digest-mismatch"};
    case Kind::too_large: return {413, "too-large"};
    case Kind::too_many: return {429, "too-many-requests"};
    case Kind::incomplete: return {409, "incomplete"};
    case Kind::storage_full: return {507, "storage-full"};
    case Kind::unavailable: break;
  }
  return {503, "busy"};
}

}  // namespace

ApiResponse announcement_answer(const Announcement& announcement, std::uint64_t part_max) {
  json refused = json::array();
  for (const auto& [sha256, refusal] : announcement.refused) {
    refused.push_back(
        {{"sha256", sha256.hex()}, {"code", name_of(refusal.code)}, {"detail", short_detail(refusal.detail)}});
  }
  ApiResponse response =
      json_answer(announcement.opened ? 201 : 200, {{"upload_id", announcement.upload},
                                                    {"missing", digests(announcement.missing)},
                                                    {"known", digests(announcement.known)},
                                                    {"refused", std::move(refused)},
                                                    {"part_max", part_max},
                                                    {"expires_at", time_text(announcement.expires_ms)}});
  response.headers.emplace_back("Location", "/v1/uploads/" + announcement.upload);
  return response;
}

ApiResponse completion_answer(const Completion& completion) {
  ApiResponse response = json_answer(202, {{"upload_id", completion.upload}, {"pending", completion.pending}});
  if (completion.pending > 0) response.headers.emplace_back("Retry-After", kSoon_s);
  return response;
}

ApiResponse status_answer(const UploadStatus& status) {
  json tiles = json::array();
  bool pending = false;
  for (const TileRow& tile : status.tiles) {
    const bool rejected = tile.verdict == Verdict::rejected;
    const ReasonCode code = tile.code.value_or(ReasonCode::policy);
    pending = pending || !tile.verdict;
    tiles.push_back({{"sha256", tile.sha256.hex()},
                     {"verdict", verdict_of(tile)},
                     {"code", rejected ? json(name_of(code)) : json()},
                     {"detail", short_detail(tile.detail)},
                     {"retryable", rejected && retryable(code)}});
  }
  ApiResponse response = json_answer(200, {{"upload_id", status.upload.name},
                                           {"batch", status.upload.batch},
                                           {"state", name_of(status.upload.state)},
                                           {"expires_at", time_text(status.upload.expires_ms)},
                                           {"tiles", std::move(tiles)}});
  response.headers.emplace_back("Cache-Control", "no-store");
  if (pending) response.headers.emplace_back("Retry-After", kSoon_s);
  return response;
}

ApiResponse reason_codes_answer() {
  json codes = json::array();
  for (const ReasonCode code : all_reason_codes()) {
    codes.push_back({{"code", name_of(code)}, {"retryable", retryable(code)}, {"meaning", meaning_of(code)}});
  }
  return json_answer(200, {{"version", kReasonCodesVersion}, {"codes", std::move(codes)}});
}

ApiResponse health_answer(const std::string& trouble, bool fails) {
  const char* status = trouble.empty() ? "pass" : fails ? "fail" : "warn";
  ApiResponse response = json_answer(fails ? 503 : 200, {{"status", status}, {"reason", short_detail(trouble)}});
  response.headers.emplace_back("Cache-Control", "no-store");
  return response;
}

ApiResponse later(int status, std::string type, std::string detail) {
  ApiResponse response = answer({.status = status, .type = std::move(type), .detail = std::move(detail)});
  response.headers.emplace_back("Retry-After", kSoon_s);
  return response;
}

ApiResponse denial_answer(const Denial& denial) {
  const auto [status, type] = shown(denial.kind);
  ApiResponse response = answer({.status = status, .type = type, .detail = denial.detail});
  if (denial.offset) response.headers.emplace_back("Upload-Offset", std::to_string(*denial.offset));
  if (denial.kind == Kind::incomplete) {
    json document = json::parse(response.body);
    document["missing"] = digests(denial.missing);
    response.body = document.dump();
  }
  if (denial.kind == Kind::unavailable || denial.kind == Kind::pack_busy || denial.kind == Kind::too_many) {
    response.headers.emplace_back("Retry-After", kSoon_s);
  }
  constexpr const char* kMinutes_s = "300";
  if (denial.kind == Kind::storage_full) response.headers.emplace_back("Retry-After", kMinutes_s);
  return response;
}

}  // namespace nadir
