#include "candidates/upload_path.hpp"

#include <algorithm>
#include <charconv>

#include "upload/batch.hpp"
#include "upload/pack.hpp"
#include "base/bytes.hpp"

namespace nadir {
namespace {

constexpr std::string_view kUploads = "/v1/uploads";

std::optional<std::uint64_t> whole_number(const std::string& text) {
  std::uint64_t value = 0;
  const char* const end = text.data() + text.size();
  const auto [stopped, error] = std::from_chars(text.data(), end, value);
  if (error != std::errc{} || stopped != end) return std::nullopt;
  return value;
}

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

std::string media_type(std::string_view text) {
  std::string type(text.substr(0, text.find(';')));
  while (type.ends_with(' ')) type.pop_back();
  std::transform(type.begin(), type.end(), type.begin(), [](unsigned char c) { return std::tolower(c); });
  return type;
}

std::optional<UploadWay> way_of(std::string_view path, std::string_view method, std::uint64_t part_max) {
  if (path == "/v1/health") return UploadWay{.admission = {.path = UploadPath::health}, .methods = "GET, HEAD"};
  if (path == "/v1/reason-codes")
    return UploadWay{.admission = {.path = UploadPath::reason_codes}, .methods = "GET, HEAD"};
  if (path == kUploads) {
    return UploadWay{.admission = {.path = UploadPath::uploads},
                     .methods = "POST",
                     .body_max = kMaxBatchSize,
                     .media = "application/json"};
  }
  if (!path.starts_with(kUploads) || path[kUploads.size()] != '/') return std::nullopt;
  path.remove_prefix(kUploads.size() + 1);
  const std::size_t end = std::min(path.find('/'), path.size());
  UploadWay way{.admission = {.path = UploadPath::upload, .upload = std::string(path.substr(0, end))},
                .methods = "GET, HEAD"};
  path.remove_prefix(end);
  if (path.empty()) return way;
  if (path == "/complete") {
    way.admission.path = UploadPath::complete;
    way.methods = "POST";
    return way;
  }
  constexpr std::string_view kPacks = "/packs/";
  if (!path.starts_with(kPacks)) return std::nullopt;
  way.admission.path = UploadPath::pack;
  way.admission.pack = Sha256::from_hex(path.substr(kPacks.size()));
  way.methods = "HEAD, PATCH";
  if (method == "PATCH") way.body_max = part_max, way.media = "application/octet-stream";
  if (!way.admission.pack) return std::nullopt;
  return way;
}

bool lists(std::string_view methods, std::string_view method) {
  const std::size_t at = methods.find(method);
  return !method.empty() && at != std::string_view::npos && (at == 0 || methods[at - 1] == ' ') &&
         (at + method.size() == methods.size() || methods[at + method.size()] == ',');
}

std::variant<PartHeader, std::string> part_header(const UploadRequest& request) {
  const auto offset = request.upload_offset ? whole_number(*request.upload_offset) : std::nullopt;
  if (!offset) return "Upload-Offset: where in the pack the part begins, a whole number";
  const auto digest = request.content_digest ? part_digest(*request.content_digest) : std::nullopt;
  if (!digest) return "Content-Digest: sha-256=:BASE64: of the part";
  const auto length = request.upload_length ? whole_number(*request.upload_length) : std::nullopt;
  if (request.upload_length && !length) return "Upload-Length: a whole number";
  if (length && *length <= kPackHeadSize + kPackEntrySize) return "Upload-Length: no pack is that short";
  return PartHeader{.offset = *offset, .length = length, .digest = *digest};
}

}  // namespace nadir
