#include "upload/service_client.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <nlohmann/json.hpp>
#include <span>

#include "base/bytes.hpp"
#include "base/error.hpp"
#include "base/json.hpp"
#include "base/number_text.hpp"
#include "base/printable.hpp"
#include "upload/batch.hpp"
#include "upload/pack.hpp"
#include "upload/reason_code.hpp"

namespace nadir {
namespace {

// In strftime()'s words. Its opposite strptime() would read them by the locale, and more than they say.
constexpr std::array<std::string_view, 3> kForms{"%a, %d %b %Y %T GMT", "%A, %d-%b-%y %T GMT", "%a %b %e %T %Y"};

constexpr std::array<std::string_view, 7> kDays{"Mon", "Tue", "Wed", "Thu", "Fri", "Sat", "Sun"};
constexpr std::array<std::string_view, 7> kLongDays{"Monday", "Tuesday",  "Wednesday", "Thursday",
                                                    "Friday", "Saturday", "Sunday"};
constexpr std::array<std::string_view, 12> kMonths{"Jan", "Feb", "Mar", "Apr", "May", "Jun",
                                                   "Jul", "Aug", "Sep", "Oct", "Nov", "Dec"};

struct Parts {
  int year = 0, month = 0, day = 0, hour = 0, minute = 0, second = 0;
};

// Takes one piece after the other off the text; after the first that does not fit nothing fits any more.
class DateReader {
 public:
  explicit DateReader(std::string_view text) : rest_(text) {}

  std::optional<Parts> read(std::string_view form) {
    for (std::size_t at = 0; at < form.size(); ++at) {
      if (form[at] == '%') {
        field(form[++at]);
      } else {
        skip(form.substr(at, 1));
      }
    }
    return good_ && rest_.empty() ? std::optional(parts_) : std::nullopt;
  }

 private:
  void field(char name) {
    switch (name) {
      case 'a': one_of(kDays); return;
      case 'A': one_of(kLongDays); return;
      case 'b': parts_.month = one_of(kMonths) + 1; return;
      case 'd': parts_.day = digits(2); return;
      case 'e': parts_.day = rest_.starts_with(' ') ? (skip(" "), digits(1)) : digits(2); return;
      case 'Y': parts_.year = digits(4); return;
      case 'y':
        parts_.year = digits(2);
        parts_.year += parts_.year < 70 ? 2000 : 1900;
        return;
      default:  // 'T'
        parts_.hour = digits(2);
        skip(":");
        parts_.minute = digits(2);
        skip(":");
        parts_.second = digits(2);
    }
  }
  void skip(std::string_view piece) {
    good_ = good_ && rest_.starts_with(piece);
    if (good_) rest_.remove_prefix(piece.size());
  }
  int one_of(std::span<const std::string_view> pieces) {
    const auto fits = std::find_if(pieces.begin(), pieces.end(), [&](auto piece) { return rest_.starts_with(piece); });
    good_ = good_ && fits != pieces.end();
    if (good_) rest_.remove_prefix(fits->size());
    return static_cast<int>(fits - pieces.begin());
  }
  int digits(std::size_t count) {
    const std::string_view piece = rest_.substr(0, count);
    good_ = good_ && piece.size() == count &&
            std::all_of(piece.begin(), piece.end(), [](char c) { return c >= '0' && c <= '9'; });
    if (!good_) return 0;
    rest_.remove_prefix(count);
    return whole_number<int>(piece).value_or(0);
  }

  std::string_view rest_;
  Parts parts_;
  bool good_ = true;
};

}  // namespace

std::optional<UtcTime> parse_http_date(std::string_view text) {
  for (const std::string_view form : kForms) {
    if (const auto parts = DateReader(text).read(form)) {
      return parse_utc(fmt::format("{:04}-{:02}-{:02}T{:02}:{:02}:{:02}Z", parts->year, parts->month, parts->day,
                                   parts->hour, parts->minute, parts->second));
    }
  }
  return std::nullopt;
}

namespace {

constexpr std::size_t kLongestDetail = 500;
constexpr std::int64_t kLeastPart = 4096;

nlohmann::json parse(std::string_view body) {
  return parse_json(body, "the service's answer", {.max_depth = 8, .allow_floats = true});
}

JsonReader reader_of(const nlohmann::json& document) {
  return {document, {.name = "the service's answer", .what = "the service's answer violates the contract"}};
}

// The name goes into paths: nothing but letters, digits, '_' and '-'.
std::string upload_id(const JsonReader& in) {
  const std::string& id = in.text("upload_id", {.least = 8, .most = 64});
  const bool good = std::all_of(id.begin(), id.end(), [](char c) {
    return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '_' || c == '-';
  });
  if (!good) in.refuse("upload_id", "8 to 64 letters, digits, '_' and '-'");
  return id;
}

std::vector<Sha256> digests(const JsonReader& in, const char* name) {
  const JsonReader list = in.array(name, {.most = kMaxBatchTiles});
  std::vector<Sha256> result;
  for (std::size_t i = 0; i < list.size(); ++i) result.push_back(list.digest(i));
  return result;
}

std::string reason(const JsonReader& in) { return std::string(name_of(in.choice("code", all_reason_codes()))); }

std::string detail(const JsonReader& in) { return printable(in.text("detail", {.most = 4 * kLongestDetail})); }

VerdictReply verdict(const JsonReader& in) {
  VerdictReply result{.sha256 = in.digest("sha256")};
  const std::string_view word = in.choice("verdict", {"accepted", "rejected", "duplicate", "pending"});
  if (word == "accepted") {
    result.kind = VerdictReply::Kind::accepted;
  } else if (word == "rejected") {
    result.kind = VerdictReply::Kind::rejected;
    result.code = reason(in);
  } else if (word == "duplicate") {
    result.kind = VerdictReply::Kind::duplicate;
  }
  result.detail = detail(in);
  return result;
}

}  // namespace

AnnouncementReply parse_announcement(std::string_view body) {
  const nlohmann::json document = parse(body);
  const JsonReader in = reader_of(document);
  AnnouncementReply result;
  result.upload = upload_id(in);
  result.missing = digests(in, "missing");
  result.known = digests(in, "known");
  const JsonReader refused = in.array("refused", {.most = kMaxBatchTiles});
  for (std::size_t i = 0; i < refused.size(); ++i) {
    const JsonReader tile = refused.object(i);
    result.refused.push_back({tile.digest("sha256"), reason(tile), detail(tile)});
  }
  result.part_max = static_cast<std::uint64_t>(in.integer("part_max", kLeastPart, std::int64_t{kMaxPackSize}));
  result.expires_at = in.time("expires_at");
  return result;
}

StatusReply parse_upload_status(std::string_view body) {
  const nlohmann::json document = parse(body);
  const JsonReader in = reader_of(document);
  StatusReply result{.upload = upload_id(in), .batch = in.text("batch", {.most = 64})};
  result.complete = in.choice("state", {"open", "judging", "judged"}) != "open";
  const JsonReader tiles = in.array("tiles", {.most = kMaxBatchTiles});
  for (std::size_t i = 0; i < tiles.size(); ++i) result.tiles.push_back(verdict(tiles.object(i)));
  return result;
}

std::string problem_text(std::string_view body) {
  try {
    const nlohmann::json document = parse(body);
    const JsonReader in = reader_of(document);
    const std::string& title = in.text("title", {.most = kLongestDetail});
    return printable(fmt::format("{}: {}", title, in.text("detail", {.most = kLongestDetail})));
  } catch (const Error&) {
    return body.empty() ? "without a body" : "with a body that is not a problem document";
  }
}

namespace {

std::optional<std::uint64_t> number_header(const HttpReply& reply, const char* name) {
  const std::string* text = reply.header(name);
  return text == nullptr ? std::nullopt : whole_number<std::uint64_t>(*text);
}

std::optional<UtcTime> date_header(const HttpReply& reply, const char* name) {
  const std::string* text = reply.header(name);
  return text == nullptr ? std::nullopt : parse_http_date(*text);
}

// Seconds, or a date. A date is of the service's clock, so it counts from the reply's own Date; without that the
// back-off decides. A day at most.
std::optional<std::int64_t> retry_after_s(const HttpReply& reply) {
  constexpr std::int64_t kDay_s = 86'400;
  if (const auto seconds = number_header(reply, "retry-after")) {
    return static_cast<std::int64_t>(std::min<std::uint64_t>(*seconds, kDay_s));
  }
  const auto until = date_header(reply, "retry-after"), sent = date_header(reply, "date");
  if (!until || !sent) return std::nullopt;
  return std::clamp<std::int64_t>(until->unix_s - sent->unix_s, 0, kDay_s);
}

}  // namespace

std::string_view name_of(TransferError::Kind kind) {
  switch (kind) {
    case TransferError::Kind::later: return "later";
    case TransferError::Kind::forgotten: return "forgotten";
    case TransferError::Kind::conflict: return "conflict";
    case TransferError::Kind::mangled: return "mangled";
    case TransferError::Kind::too_large: return "too_large";
    case TransferError::Kind::refused: return "refused";
    case TransferError::Kind::invalid: return "nonsense";
    case TransferError::Kind::credentials: return "credentials";
    case TransferError::Kind::elsewhere: return "elsewhere";
  }
  return "nonsense";
}

namespace {

TransferError::Kind kind_of(int status) {
  switch (status) {
    case 401:
    case 403: return TransferError::Kind::credentials;
    case 404:
    case 410: return TransferError::Kind::forgotten;
    case 408:
    case 425:
    case 429: return TransferError::Kind::later;
    case 409: return TransferError::Kind::conflict;
    case 413: return TransferError::Kind::too_large;
    case 460: return TransferError::Kind::mangled;
    default: break;
  }
  if (status >= 500 && status <= 599) return TransferError::Kind::later;
  if (status >= 400) return TransferError::Kind::refused;
  if (status >= 300) return TransferError::Kind::elsewhere;
  return TransferError::Kind::invalid;  // success, but not the one that was expected
}

TransferError error_from(const HttpReply& reply) {
  TransferError error{kind_of(reply.status), fmt::format("{} {}", reply.status, problem_text(reply.body)),
                      retry_after_s(reply)};
  if (error.kind == TransferError::Kind::elsewhere) error.text = fmt::format("{}, a redirect", reply.status);
  if (error.kind == TransferError::Kind::conflict) error.offset = number_header(reply, "upload-offset");
  return error;
}

TransferError error_from(const NoReply& none) { return {TransferError::Kind::later, none.why}; }

// The reply when it has one of these statuses, else the error.
Answer<HttpReply> expect(HttpResult result, std::initializer_list<int> statuses) {
  if (const auto* none = std::get_if<NoReply>(&result)) return error_from(*none);
  auto& reply = std::get<HttpReply>(result);
  for (const int status : statuses) {
    if (reply.status == status) return std::move(reply);
  }
  return error_from(reply);
}

// Reads the reply's body; one outside of the contract is invalid.
template <typename Value, typename Read>
Answer<Value> read_reply(Answer<HttpReply> answer, const Read& read) {
  if (auto* error = std::get_if<TransferError>(&answer)) return std::move(*error);
  try {
    return read(std::get<HttpReply>(answer));
  } catch (const Error& error) {
    return TransferError{TransferError::Kind::invalid,
                         fmt::format("an invalid answer: {}: expected {}, found {}", error.text().where,
                                     error.text().expected, error.text().found)};
  }
}

Answer<std::uint64_t> read_offset(Answer<HttpReply> answer, std::uint64_t most) {
  return read_reply<std::uint64_t>(std::move(answer), [&](const HttpReply& reply) {
    const auto offset = number_header(reply, "upload-offset");
    if (!offset || *offset > most) {
      throw Error({.what = "the service's answer violates the contract",
                   .where = "Upload-Offset",
                   .expected = fmt::format("a whole number up to {}", most),
                   .found = offset ? fmt::format("{}", *offset) : "no whole number"});
    }
    return *offset;
  });
}

std::string pack_path(const std::string& upload, const Sha256& pack) {
  return fmt::format("/v1/uploads/{}/packs/{}", upload, pack.hex());
}

}  // namespace

Answer<AnnouncementReply> ServiceClient::announce(const std::string& batch_id, std::string_view document) {
  return read_reply<AnnouncementReply>(
      expect(transport_.exchange({.method = "POST",
                                  .path = "/v1/uploads",
                                  .headers = {{"Idempotency-Key", batch_id}, {"Content-Type", "application/json"}},
                                  .body = as_bytes(document)}),
             {200, 201}),
      [](const HttpReply& reply) { return parse_announcement(reply.body); });
}

Answer<std::uint64_t> ServiceClient::offset(const std::string& upload, const Sha256& pack) {
  HttpResult result = transport_.exchange({.method = "HEAD", .path = pack_path(upload, pack)});
  // No byte is there yet, or the whole upload is gone: HEAD has no body; the next call will tell.
  if (const auto* reply = std::get_if<HttpReply>(&result); reply != nullptr && reply->status == 404) {
    return std::uint64_t{0};
  }
  return read_offset(expect(std::move(result), {200, 204}), kMaxPackSize);
}

Answer<std::uint64_t> ServiceClient::send_part(const std::string& upload, const Sha256& pack, std::uint64_t pack_size,
                                               std::uint64_t offset, ByteView part) {
  HttpResult result =
      transport_.exchange({.method = "PATCH",
                           .path = pack_path(upload, pack),
                           .headers = {{"Upload-Offset", fmt::format("{}", offset)},
                                       {"Upload-Length", fmt::format("{}", pack_size)},
                                       {"Content-Type", "application/octet-stream"},
                                       {"Content-Digest", fmt::format("sha-256=:{}:", to_base64(sha256(part).bytes))}},
                           .body = part});
  auto answer = read_offset(expect(std::move(result), {204}), pack_size);
  // Another call still writes this pack, our own one before the line broke perhaps: no other offset, but later.
  if (auto* error = std::get_if<TransferError>(&answer);
      error != nullptr && error->kind == TransferError::Kind::conflict && error->retry_after_s) {
    error->kind = TransferError::Kind::later;
  }
  return answer;
}

Answer<Accepted> ServiceClient::complete(const std::string& upload) {
  auto answer =
      expect(transport_.exchange({.method = "POST", .path = fmt::format("/v1/uploads/{}/complete", upload)}), {202});
  return read_reply<Accepted>(std::move(answer), [](const HttpReply& reply) { return Accepted{retry_after_s(reply)}; });
}

Answer<StatusAnswer> ServiceClient::status(const std::string& upload) {
  auto answer = expect(transport_.exchange({.method = "GET", .path = "/v1/uploads/" + upload}), {200});
  return read_reply<StatusAnswer>(std::move(answer), [](const HttpReply& reply) {
    return StatusAnswer{parse_upload_status(reply.body), retry_after_s(reply)};
  });
}

Answer<bool> ServiceClient::report_installed(std::string_view document) {
  auto answer = expect(transport_.exchange({.method = "POST",
                                            .path = "/v1/installed",
                                            .headers = {{"Content-Type", "application/json"}},
                                            .body = as_bytes(document)}),
                       {200, 201});
  const auto* error = std::get_if<TransferError>(&answer);
  if (error == nullptr) return true;
  if (error->kind == TransferError::Kind::conflict) return false;
  return *error;
}

}  // namespace nadir
