#include "sync/replies.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <nlohmann/json.hpp>

#include "base/error.hpp"
#include "base/json.hpp"
#include "base/printable.hpp"
#include "exchange/batch.hpp"
#include "exchange/pack.hpp"
#include "exchange/reason_code.hpp"

namespace nadir {
namespace {

using nlohmann::json;

constexpr std::size_t kLongestDetail = 500;

[[noreturn]] void refuse(std::string_view member, std::string expected, const json& found) {
  throw Error({.what = "the service's answer is not what the contract says",
               .where = std::string(member),
               .expected = std::move(expected),
               .found = printable(found.dump(-1, ' ', true, json::error_handler_t::replace).substr(0, 80))});
}

json parse(std::string_view body) {
  json document = parse_json(body, "the service's answer", {.max_depth = 8, .allow_floats = true});
  if (!document.is_object()) refuse("the answer", "an object", document);
  return document;
}

const json& member(const json& object, const char* name) {
  if (!object.is_object()) refuse(name, "an object around it", object);
  const auto found = object.find(name);
  if (found == object.end()) refuse(name, "this member", nullptr);
  return *found;
}

std::string text(const json& object, const char* name, std::size_t longest) {
  const json& value = member(object, name);
  if (!value.is_string() || value.get_ref<const std::string&>().size() > longest) {
    refuse(name, fmt::format("text of at most {} bytes", longest), value);
  }
  return value.get<std::string>();
}

// The name goes into paths: nothing but letters, digits, '_' and '-'.
std::string upload_id(const json& object) {
  std::string id = text(object, "upload_id", 64);
  const bool good =
      id.size() >= 8 && std::all_of(id.begin(), id.end(), [](char c) {
        return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '_' || c == '-';
      });
  if (!good) refuse("upload_id", "8 to 64 letters, digits, '_' and '-'", id);
  return id;
}

const json& list(const json& object, const char* name) {
  const json& value = member(object, name);
  if (!value.is_array() || value.size() > kMaxBatchTiles) {
    refuse(name, fmt::format("a list of at most {}", kMaxBatchTiles), value);
  }
  return value;
}

Sha256 digest(const json& value, const char* name) {
  const auto digest = value.is_string() ? Sha256::from_hex(value.get_ref<const std::string&>()) : std::nullopt;
  if (!digest) refuse(name, "64 lower-case hexadecimal digits", value);
  return *digest;
}

std::vector<Sha256> digests(const json& object, const char* name) {
  std::vector<Sha256> result;
  for (const json& item : list(object, name)) result.push_back(digest(item, name));
  return result;
}

std::string reason(const json& object) {
  std::string code = text(object, "code", 64);
  if (!parse_reason_code(code)) refuse("code", "a reason of the closed list", code);
  return code;
}

std::string detail(const json& object) { return printable(text(object, "detail", 4 * kLongestDetail)); }

VerdictReply verdict(const json& item) {
  VerdictReply result{.sha256 = digest(member(item, "sha256"), "sha256")};
  const std::string word = text(item, "verdict", 16);
  if (word == "accepted") {
    result.kind = VerdictReply::Kind::accepted;
  } else if (word == "rejected") {
    result.kind = VerdictReply::Kind::rejected;
    result.code = reason(item);
  } else if (word == "duplicate") {
    result.kind = VerdictReply::Kind::duplicate;
  } else if (word != "pending") {
    refuse("verdict", "accepted, rejected, duplicate or pending", word);
  }
  result.detail = detail(item);
  return result;
}

}  // namespace

AnnouncementReply parse_announcement(std::string_view body) {
  const json document = parse(body);
  AnnouncementReply result;
  result.upload = upload_id(document);
  result.missing = digests(document, "missing");
  result.known = digests(document, "known");
  for (const json& item : list(document, "refused")) {
    result.refused.push_back({digest(member(item, "sha256"), "sha256"), reason(item), detail(item)});
  }
  const json& part_max = member(document, "part_max");
  if (!part_max.is_number_unsigned() || part_max < 4096 || part_max > kMaxPackSize) {
    refuse("part_max", fmt::format("a whole number from 4096 to {}", kMaxPackSize), part_max);
  }
  result.part_max = part_max.get<std::uint64_t>();
  const auto expires_at = parse_utc(text(document, "expires_at", 32));
  if (!expires_at) refuse("expires_at", "a time like 2030-01-01T00:00:00Z", document["expires_at"]);
  result.expires_at = *expires_at;
  return result;
}

StatusReply parse_upload_status(std::string_view body) {
  const json document = parse(body);
  StatusReply result{.upload = upload_id(document), .batch = text(document, "batch", 64)};
  const std::string state = text(document, "state", 16);
  if (state != "open" && state != "judging" && state != "judged") {
    refuse("state", "open, judging or judged", state);
  }
  result.complete = state != "open";
  for (const json& item : list(document, "tiles")) result.tiles.push_back(verdict(item));
  return result;
}

std::string problem_text(std::string_view body) {
  try {
    const json document = parse(body);
    const std::string title = text(document, "title", kLongestDetail);
    return printable(fmt::format("{}: {}", title, text(document, "detail", kLongestDetail)));
  } catch (const Error&) {
    return body.empty() ? "without words" : "with words that are no problem document";
  }
}

}  // namespace nadir
