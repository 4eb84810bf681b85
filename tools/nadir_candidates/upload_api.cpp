#include "nadir_candidates/upload_api.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <nlohmann/json.hpp>

#include "base/bytes.hpp"
#include "base/error.hpp"
#include "base/number_text.hpp"
#include "base/printable.hpp"
#include "http/access.hpp"
#include "upload/batch.hpp"
#include "upload/pack.hpp"

namespace nadir {

namespace {

constexpr std::string_view kUploads = "/v1/uploads";

// "sha-256=:BASE64:" (RFC 9530), this one member. A spelling of which no digest is the canonical one is no bytes'
// digest: what comes with it will not fit.
std::optional<Sha256> part_digest(std::string_view text) {
  constexpr std::string_view kBegin = "sha-256=:";
  constexpr std::string_view kDigits = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  constexpr std::size_t kLength = 43;
  if (text.size() != kBegin.size() + kLength + 2 || !text.starts_with(kBegin) || !text.ends_with("=:") ||
      text.substr(kBegin.size(), kLength).find_first_not_of(kDigits) != std::string_view::npos) {
    return std::nullopt;
  }
  Sha256 digest;
  if (const auto bytes = from_base64(text.substr(kBegin.size(), kLength + 1))) {
    std::copy(bytes->begin(), bytes->end(), digest.bytes.begin());
  }
  return digest;
}

}  // namespace

std::optional<UploadRoute> upload_route(std::string_view path, std::string_view method, std::uint64_t part_max) {
  if (path == "/v1/health") return UploadRoute{.admission = {.path = UploadPath::health}, .methods = "GET, HEAD"};
  if (path == "/v1/reason-codes")
    return UploadRoute{.admission = {.path = UploadPath::reason_codes}, .methods = "GET, HEAD"};
  if (path == kUploads) {
    return UploadRoute{.admission = {.path = UploadPath::uploads},
                       .methods = "POST",
                       .body_max = kMaxBatchSize,
                       .media = "application/json",
                       .scope = TokenScope::upload};
  }
  if (path == "/v1/installed") {
    UploadRoute route{
        .admission = {.path = UploadPath::installed}, .methods = "GET, HEAD, POST", .scope = TokenScope::read};
    if (method == "POST") {
      route.body_max = kMaxInstalledSize, route.media = "application/json", route.scope = TokenScope::upload;
    }
    return route;
  }
  if (!path.starts_with(kUploads) || path[kUploads.size()] != '/') return std::nullopt;
  path.remove_prefix(kUploads.size() + 1);
  const std::size_t end = std::min(path.find('/'), path.size());
  UploadRoute route{.admission = {.path = UploadPath::upload, .upload = std::string(path.substr(0, end))},
                    .methods = "GET, HEAD",
                    .scope = TokenScope::upload};
  path.remove_prefix(end);
  if (path.empty()) return route;
  if (path == "/complete") {
    route.admission.path = UploadPath::complete;
    route.methods = "POST";
    return route;
  }
  constexpr std::string_view kPacks = "/packs/";
  if (!path.starts_with(kPacks)) return std::nullopt;
  route.admission.path = UploadPath::pack;
  route.admission.pack = Sha256::from_hex(path.substr(kPacks.size()));
  route.methods = "HEAD, PATCH";
  if (method == "PATCH") route.body_max = part_max, route.media = "application/octet-stream";
  if (!route.admission.pack) return std::nullopt;
  return route;
}

bool UploadRoute::allows(std::string_view method) const {
  const std::size_t at = methods.find(method);
  return !method.empty() && at != std::string_view::npos && (at == 0 || methods[at - 1] == ' ') &&
         (at + method.size() == methods.size() || methods[at + method.size()] == ',');
}

std::variant<PartHeader, std::string> part_header(const ApiRequest& request) {
  const std::string* const offset_text = request.header("upload-offset");
  const std::string* const length_text = request.header("upload-length");
  const std::string* const digest_text = request.header("content-digest");
  const auto offset = offset_text ? whole_number<std::uint64_t>(*offset_text) : std::nullopt;
  if (!offset) return "send Upload-Offset: the byte of the pack at which the part begins, a whole number";
  const auto digest = digest_text ? part_digest(*digest_text) : std::nullopt;
  if (!digest) return "send Content-Digest: sha-256=:BASE64: of the part";
  const auto length = length_text ? whole_number<std::uint64_t>(*length_text) : std::nullopt;
  if (length_text && !length) return "Upload-Length must be a whole number";
  if (length && *length <= kPackHeadSize + kPackEntrySize) return "Upload-Length is less than any pack has";
  return PartHeader{.offset = *offset, .length = length, .digest = *digest};
}

namespace {

using nlohmann::json;
using Kind = Denial::Kind;

constexpr std::size_t kLongestDetail = 500;
constexpr const char* kSoon_s = "2";

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

struct StatusAndType {
  int status;
  const char* type;
};

StatusAndType status_of(Kind kind) {
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
    case Kind::report_invalid: return {422, "report-invalid"};
    case Kind::report_older: return {409, "report-older"};
    case Kind::storage_full: return {507, "storage-full"};
    case Kind::unavailable: break;
  }
  return {503, "busy"};
}

}  // namespace

json installed_json(const InstalledStore::Entry& entry) {
  json aircraft{{"airframe", printable(entry.airframe)}, {"damaged", short_detail(entry.damage)}};
  if (!entry.record) return aircraft;
  const InstalledReport& report = entry.record->report.report;
  aircraft["number"] = report.number;
  aircraft["received_at"] = to_rfc3339(entry.record->received_at);
  aircraft["reported_at"] = to_rfc3339(report.reported_at);
  aircraft["package"] = report.package.hex();
  aircraft["series"] = printable(report.series);
  aircraft["sequence"] = report.sequence;
  aircraft["highest_sequence"] = entry.record->highest_sequence;
  aircraft["root_version"] = report.root_version;
  aircraft["verified_at"] = to_rfc3339(report.verified_at);
  aircraft["result"] = report.accepted ? "accepted" : "refused";
  aircraft["findings"] = report.findings;
  aircraft["key"] = entry.record->report.document.signatures.front().keyid;
  return aircraft;
}

namespace {

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

ApiResponse health_answer(const ServiceFault& fault, const std::vector<std::string>& notes) {
  const char* status = fault.reason.empty() ? "pass" : fault.fails ? "fail" : "warn";
  ApiResponse response = json_answer(fault.fails ? 503 : 200,
                                     {{"status", status}, {"reason", short_detail(fault.reason)}, {"notes", notes}});
  response.headers.emplace_back("Cache-Control", "no-store");
  return response;
}

ApiResponse denial_answer(const Denial& denial) {
  const auto [status, type] = status_of(denial.kind);
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

ApiResponse problem(int status, const char* type, std::string detail) {
  return answer({.status = status, .type = type, .detail = std::move(detail)});
}

}  // namespace

ApiResponse later(int status, std::string type, std::string detail) {
  ApiResponse response = answer({.status = status, .type = std::move(type), .detail = std::move(detail)});
  response.headers.emplace_back("Retry-After", kSoon_s);
  return response;
}

std::variant<Admission, ApiResponse> UploadApi::admit(const ApiRequest& header) const {
  if (loopback_ && !names_loopback(header.host)) {
    return problem(421, "host", "this service listens on a loopback address: call it as localhost, 127.0.0.1 or [::1]");
  }
  const std::string_view path = header.path();
  const auto caller = clients_.find(header.authorization);
  auto route = upload_route(path, header.method, service_.options().part_max);
  if (path != "/v1/health") {
    const bool expired = caller && caller->token.expires && *caller->token.expires <= service_.now();
    const bool in_scope = caller && (!route || !route->scope || caller->token.scopes.contains(*route->scope));
    if (!caller || expired || !in_scope) return not_admitted(caller.get(), route ? &*route : nullptr, header);
  }
  if (!route) return problem(404, "not-found", "there is no such path; schemas/candidates.openapi.yaml lists them");
  if (!route->allows(header.method)) {
    ApiResponse refusal =
        problem(405, "method", fmt::format("this path accepts {}, not {}", route->methods, header.method));
    refusal.headers.emplace_back("Allow", route->methods);
    return refusal;
  }
  if (route->admission.path != UploadPath::health) route->admission.caller = caller;
  if (route->media.empty()) {
    if (header.content_length.value_or(0) > 0 || header.other_encoding) {
      return problem(413, "too-large", "send this call without a body");
    }
    return route->admission;
  }
  if (!header.content_length || header.other_encoding) {
    return problem(411, "length-required", "send the body unencoded, with Content-Length");
  }
  if (*header.content_length > route->body_max) {
    return problem(413, "too-large",
                   fmt::format("a body of {} bytes was announced; at most {} are accepted here", *header.content_length,
                               route->body_max));
  }
  if (media_type(header.content_type) != route->media) {
    return problem(415, "media-type", fmt::format("send Content-Type: {}", route->media));
  }
  route->admission.body_bytes = *header.content_length;
  return route->admission;
}

// Without a known token, with one that has expired, or with one for something else.
ApiResponse UploadApi::not_admitted(const Clients::Client* caller, const UploadRoute* route,
                                    const ApiRequest& header) const {
  AuditEntry entry{.act = "call", .result = {}, .subject = header.method + " " + header.target};
  ApiResponse refusal;
  if (caller == nullptr) {
    entry.result = "no known token";
    refusal = problem(401, "unauthorized", "send Authorization: Bearer TOKEN");
  } else {
    entry.token = caller->token.id, entry.client = caller->client.name;
    if (caller->token.expires && *caller->token.expires <= service_.now()) {
      entry.result = "token expired";
      refusal = problem(401, "token-expired",
                        fmt::format("token {} expired {}; ask the service's operator for a new one", caller->token.id,
                                    to_rfc3339(*caller->token.expires)));
    } else {
      entry.result = "token of another scope";
      service_.audit().record(entry);
      return problem(403, "scope", fmt::format("this call needs a token of scope {}", name_of(route->scope.value())));
    }
  }
  service_.audit().record(entry);
  refusal.headers.emplace_back("WWW-Authenticate", "Bearer");
  return refusal;
}

ApiResponse UploadApi::answer(const Admission& admission, const ApiRequest& request) const {
  ApiResponse response;
  try {
    response = route(admission, request);
  } catch (const Error& error) {
    // The catalogue or the disk; what was wrong with the request itself is a denial.
    response = later(503, "busy", error.what());
  } catch (const std::exception& error) {
    response = problem(500, "internal", error.what());
  }
  response.headers.emplace_back("X-Content-Type-Options", "nosniff");
  return response;
}

ApiResponse UploadApi::route(const Admission& admission, const ApiRequest& request) const {
  switch (admission.path) {
    case UploadPath::health: return health();
    case UploadPath::reason_codes: return reason_codes_answer();
    case UploadPath::uploads: return announce(admission.client(), request);
    case UploadPath::upload: return status(admission.client(), admission.upload);
    case UploadPath::complete: return complete(admission.client(), admission.upload);
    case UploadPath::installed:
      return request.method == "POST" ? report_installed(admission.client(), request) : installed();
    case UploadPath::pack: break;
  }
  return pack(admission, request);
}

ApiResponse UploadApi::health() const { return health_answer(service_.fault(), notes_); }

ApiResponse UploadApi::announce(const UploadClient& client, const ApiRequest& request) const {
  const std::string* const key = request.header("idempotency-key");
  if (key == nullptr) return problem(400, "malformed", "send Idempotency-Key: the batch's id");
  const auto result = service_.announce(client, *key, request.body);
  if (const auto* denial = std::get_if<Denial>(&result)) return denial_answer(*denial);
  return announcement_answer(std::get<Announcement>(result), service_.options().part_max);
}

ApiResponse UploadApi::status(const UploadClient& client, const std::string& upload) const {
  const auto result = service_.status(client, upload);
  if (const auto* denial = std::get_if<Denial>(&result)) return denial_answer(*denial);
  return status_answer(std::get<UploadStatus>(result));
}

ApiResponse UploadApi::complete(const UploadClient& client, const std::string& upload) const {
  std::optional<std::int64_t> to_evaluate;
  const auto result = service_.complete(client, upload, to_evaluate);
  if (to_evaluate) evaluate_();
  if (const auto* denial = std::get_if<Denial>(&result)) return denial_answer(*denial);
  return completion_answer(std::get<Completion>(result));
}

ApiResponse UploadApi::report_installed(const UploadClient& client, const ApiRequest& request) const {
  const auto result = service_.report_installed(client, request.body);
  if (const auto* denial = std::get_if<Denial>(&result)) return denial_answer(*denial);
  const bool stored = std::get<InstalledStore::Outcome>(result) == InstalledStore::Outcome::stored;
  return json_answer(stored ? 201 : 200, {{"result", stored ? "stored" : "known"}});
}

ApiResponse UploadApi::installed() const {
  json aircraft = json::array();
  for (const InstalledStore::Entry& entry : service_.installed()) aircraft.push_back(installed_json(entry));
  ApiResponse response = json_answer(200, {{"aircraft", std::move(aircraft)}});
  response.headers.emplace_back("Cache-Control", "no-store");
  return response;
}

ApiResponse UploadApi::pack(const Admission& admission, const ApiRequest& request) const {
  if (request.method == "HEAD") {
    const auto result = service_.offset(admission.client(), admission.upload, *admission.pack);
    if (const auto* denial = std::get_if<Denial>(&result)) return denial_answer(*denial);
    const auto& offset = std::get<PackOffset>(result);
    ApiResponse response{.content_type = "application/octet-stream",
                         .headers = {{"Upload-Offset", std::to_string(offset.offset)}, {"Cache-Control", "no-store"}}};
    if (offset.length) response.headers.emplace_back("Upload-Length", std::to_string(*offset.length));
    return response;
  }
  const auto header = part_header(request);
  if (const auto* fault = std::get_if<std::string>(&header)) return problem(400, "malformed", *fault);
  const auto result = service_.append(admission.client(), admission.upload, *admission.pack,
                                      std::get<PartHeader>(header), as_bytes(request.body));
  if (const auto* denial = std::get_if<Denial>(&result)) return denial_answer(*denial);
  return {.status = 204,
          .content_type = "",
          .headers = {{"Upload-Offset", std::to_string(std::get<PackOffset>(result).offset)}}};
}

}  // namespace nadir
