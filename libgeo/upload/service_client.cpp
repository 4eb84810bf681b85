#include "upload/service_client.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>

#include "base/error.hpp"
#include "upload/pack.hpp"
#include "upload/http_date.hpp"
#include "base/bytes.hpp"

namespace nadir {
namespace {

std::optional<std::uint64_t> number_header(const HttpReply& reply, const char* name) {
  const std::string* text = reply.header(name);
  if (text == nullptr || text->empty()) return std::nullopt;
  std::uint64_t value = 0;
  const auto [end, error] = std::from_chars(text->data(), text->data() + text->size(), value);
  if (error != std::errc{} || end != text->data() + text->size()) return std::nullopt;
  return value;
}

std::optional<UtcTime> date_header(const HttpReply& reply, const char* name) {
  const std::string* text = reply.header(name);
  return text == nullptr ? std::nullopt : parse_http_date(*text);
}

// Seconds, or a date. A date means the service's clock, so it counts from the reply's own Date; without that nobody
// knows how long it is, and the back-off decides. A day at most.
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

std::string_view name_of(Trouble::Kind kind) {
  switch (kind) {
    case Trouble::Kind::later: return "later";
    case Trouble::Kind::forgotten: return "forgotten";
    case Trouble::Kind::conflict: return "conflict";
    case Trouble::Kind::mangled: return "mangled";
    case Trouble::Kind::too_large: return "too_large";
    case Trouble::Kind::refused: return "refused";
    case Trouble::Kind::nonsense: return "nonsense";
    case Trouble::Kind::credentials: return "credentials";
    case Trouble::Kind::elsewhere: return "elsewhere";
  }
  return "nonsense";
}

namespace {

Trouble::Kind kind_of(int status) {
  switch (status) {
    case 401:
    case 403: return Trouble::Kind::credentials;
    case 404:
    case 410: return Trouble::Kind::forgotten;
    case 408:
    case 425:
    case 429: return Trouble::Kind::later;
    case 409: return Trouble::Kind::conflict;
    case 413: return Trouble::Kind::too_large;
    case 460: return Trouble::Kind::mangled;
    default: break;
  }
  if (status >= 500 && status <= 599) return Trouble::Kind::later;
  if (status >= 400) return Trouble::Kind::refused;
  if (status >= 300) return Trouble::Kind::elsewhere;
  return Trouble::Kind::nonsense;  // success, but not the one that was expected
}

Trouble trouble_of(const HttpReply& reply) {
  Trouble trouble{kind_of(reply.status), fmt::format("{} {}", reply.status, problem_text(reply.body)),
                  retry_after_s(reply)};
  if (trouble.kind == Trouble::Kind::elsewhere) trouble.text = fmt::format("{}, a redirect", reply.status);
  if (trouble.kind == Trouble::Kind::conflict) trouble.offset = number_header(reply, "upload-offset");
  return trouble;
}

Trouble trouble_of(const NoReply& none) { return {Trouble::Kind::later, none.why}; }

// The reply when it has one of these statuses, else the trouble.
Answer<HttpReply> expect(HttpResult result, std::initializer_list<int> statuses) {
  if (const auto* none = std::get_if<NoReply>(&result)) return trouble_of(*none);
  auto& reply = std::get<HttpReply>(result);
  for (const int status : statuses) {
    if (reply.status == status) return std::move(reply);
  }
  return trouble_of(reply);
}

// Reads the reply's body; a body that is none of ours is nonsense.
template <typename Value, typename Read>
Answer<Value> read_reply(Answer<HttpReply> answer, const Read& read) {
  if (auto* trouble = std::get_if<Trouble>(&answer)) return std::move(*trouble);
  try {
    return read(std::get<HttpReply>(answer));
  } catch (const Error& error) {
    return Trouble{Trouble::Kind::nonsense, fmt::format("an answer that is none: {}", error.text().where)};
  }
}

Answer<std::uint64_t> read_offset(Answer<HttpReply> answer, std::uint64_t most) {
  return read_reply<std::uint64_t>(std::move(answer), [&](const HttpReply& reply) {
    const auto offset = number_header(reply, "upload-offset");
    if (!offset || *offset > most) throw Error({.what = "no offset", .where = "Upload-Offset"});
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
  // No byte is there yet, or the whole upload is gone: HEAD has no words; the next call will tell.
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
  if (auto* trouble = std::get_if<Trouble>(&answer);
      trouble != nullptr && trouble->kind == Trouble::Kind::conflict && trouble->retry_after_s) {
    trouble->kind = Trouble::Kind::later;
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

}  // namespace nadir
