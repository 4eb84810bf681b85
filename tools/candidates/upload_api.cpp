#include "candidates/upload_api.hpp"

#include <fmt/format.h>

#include "base/error.hpp"
#include "candidates/upload_json.hpp"
#include "http/access.hpp"

namespace nadir {
namespace {

ApiResponse problem(int status, const char* type, std::string detail) {
  return answer({.status = status, .type = type, .detail = std::move(detail)});
}

}  // namespace

std::variant<Admission, ApiResponse> UploadApi::admit(const UploadRequest& header) const {
  if (loopback_ && !names_loopback(header.host)) {
    return problem(421, "host", "this service is called by localhost, 127.0.0.1 or [::1]");
  }
  const std::string_view path = std::string_view(header.target).substr(0, header.target.find('?'));
  const UploadClient* client = clients_.find(header.authorization);
  if (path != "/v1/health" && client == nullptr) {
    ApiResponse refusal = problem(401, "unauthorized", "send Authorization: Bearer TOKEN");
    refusal.headers.emplace_back("WWW-Authenticate", "Bearer");
    return refusal;
  }
  auto way = way_of(path, header.method, service_.options().part_max);
  if (!way) return problem(404, "not-found", "there is no such path; see schemas/candidates.openapi.yaml");
  if (!lists(way->methods, header.method)) {
    ApiResponse refusal = problem(405, "method", fmt::format("this path takes {}", way->methods));
    refusal.headers.emplace_back("Allow", way->methods);
    return refusal;
  }
  way->admission.client = way->admission.path == UploadPath::health ? nullptr : client;
  if (way->media.empty()) {
    if (header.content_length.value_or(0) > 0 || header.other_encoding) {
      return problem(413, "too-large", "this call has no body");
    }
    return way->admission;
  }
  if (!header.content_length || header.other_encoding) {
    return problem(411, "length-required", "send the body as it is, with Content-Length");
  }
  if (*header.content_length > way->body_max) {
    return problem(413, "too-large", fmt::format("at most {} bytes are taken here", way->body_max));
  }
  if (media_type(header.content_type) != way->media) {
    return problem(415, "media-type", fmt::format("send Content-Type: {}", way->media));
  }
  way->admission.body_bytes = *header.content_length;
  return way->admission;
}

ApiResponse UploadApi::answer(const Admission& admission, const UploadRequest& request) const {
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

ApiResponse UploadApi::route(const Admission& admission, const UploadRequest& request) const {
  switch (admission.path) {
    case UploadPath::health: return health();
    case UploadPath::reason_codes: return reason_codes_answer();
    case UploadPath::uploads: return announce(*admission.client, request);
    case UploadPath::upload: return status(*admission.client, admission.upload);
    case UploadPath::complete: return complete(*admission.client, admission.upload);
    case UploadPath::pack: break;
  }
  return pack(admission, request);
}

ApiResponse UploadApi::health() const {
  const ServiceTrouble trouble = service_.trouble();
  return health_answer(trouble.reason, trouble.fails);
}

ApiResponse UploadApi::announce(const UploadClient& client, const UploadRequest& request) const {
  if (!request.idempotency_key) return problem(400, "malformed", "Idempotency-Key: the batch's id");
  const auto result = service_.announce(client, *request.idempotency_key, request.body);
  if (const auto* denial = std::get_if<Denial>(&result)) return denial_answer(*denial);
  return announcement_answer(std::get<Announcement>(result), service_.options().part_max);
}

ApiResponse UploadApi::status(const UploadClient& client, const std::string& upload) const {
  const auto result = service_.status(client, upload);
  if (const auto* denial = std::get_if<Denial>(&result)) return denial_answer(*denial);
  return status_answer(std::get<UploadStatus>(result));
}

ApiResponse UploadApi::complete(const UploadClient& client, const std::string& upload) const {
  std::optional<std::int64_t> to_judge;
  const auto result = service_.complete(client, upload, to_judge);
  if (to_judge) judge_(client, *to_judge);
  if (const auto* denial = std::get_if<Denial>(&result)) return denial_answer(*denial);
  return completion_answer(std::get<Completion>(result));
}

ApiResponse UploadApi::pack(const Admission& admission, const UploadRequest& request) const {
  if (request.method == "HEAD") {
    const auto result = service_.offset(*admission.client, admission.upload, *admission.pack);
    if (const auto* denial = std::get_if<Denial>(&result)) return denial_answer(*denial);
    const auto& offset = std::get<PackOffset>(result);
    ApiResponse response{.content_type = "application/octet-stream",
                         .headers = {{"Upload-Offset", std::to_string(offset.offset)}, {"Cache-Control", "no-store"}}};
    if (offset.length) response.headers.emplace_back("Upload-Length", std::to_string(*offset.length));
    return response;
  }
  const auto header = part_header(request);
  if (const auto* fault = std::get_if<std::string>(&header)) return problem(400, "malformed", *fault);
  const auto result = service_.append(*admission.client, admission.upload, *admission.pack,
                                      std::get<PartHeader>(header), as_bytes(request.body));
  if (const auto* denial = std::get_if<Denial>(&result)) return denial_answer(*denial);
  return {.status = 204,
          .content_type = "",
          .headers = {{"Upload-Offset", std::to_string(std::get<PackOffset>(result).offset)}}};
}

}  // namespace nadir
