#include "upload/replies.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <nlohmann/json.hpp>

#include "base/error.hpp"
#include "base/json.hpp"
#include "base/json_members.hpp"
#include "base/printable.hpp"
#include "upload/batch.hpp"
#include "upload/pack.hpp"
#include "upload/reason_code.hpp"

namespace nadir {
namespace {

using nlohmann::json;

constexpr std::size_t kLongestDetail = 500;
constexpr std::int64_t kLeastPart = 4096;

constexpr JsonMembers::Complaint kComplaint{"the service's answer is not what the contract says"};

json parse(std::string_view body) {
  return parse_json(body, "the service's answer", {.max_depth = 8, .allow_floats = true});
}

// A later version of the service may say more: as many members as there are.
JsonMembers members_of(const json& object, const char* where) { return {object, where, object.size(), kComplaint}; }

std::string text(const JsonMembers& in, const char* name, std::size_t longest) {
  const std::string& value = in.text(name);
  if (value.size() > longest) in.refuse(name, fmt::format("text of at most {} bytes", longest), value.substr(0, 80));
  return value;
}

// The name goes into paths: nothing but letters, digits, '_' and '-'.
std::string upload_id(const JsonMembers& in) {
  std::string id = text(in, "upload_id", 64);
  const bool good =
      id.size() >= 8 && std::all_of(id.begin(), id.end(), [](char c) {
        return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '_' || c == '-';
      });
  if (!good) in.refuse("upload_id", "8 to 64 letters, digits, '_' and '-'", id);
  return id;
}

const json& list(const JsonMembers& in, const char* name) {
  const json& value = in.member(name);
  if (!value.is_array() || value.size() > kMaxBatchTiles) {
    in.refuse(name, fmt::format("a list of at most {}", kMaxBatchTiles), value.is_array() ? json(value.size()) : value);
  }
  return value;
}

std::vector<Sha256> digests(const JsonMembers& in, const char* name) {
  std::vector<Sha256> result;
  for (const json& item : list(in, name)) {
    const auto digest = item.is_string() ? Sha256::from_hex(item.get_ref<const std::string&>()) : std::nullopt;
    if (!digest) in.refuse(name, "64 lower-case hexadecimal digits", item);
    result.push_back(*digest);
  }
  return result;
}

std::string reason(const JsonMembers& in) {
  std::string code = text(in, "code", 64);
  if (!parse_reason_code(code)) in.refuse("code", "a reason of the closed list", code);
  return code;
}

std::string detail(const JsonMembers& in) { return printable(text(in, "detail", 4 * kLongestDetail)); }

VerdictReply verdict(const JsonMembers& in) {
  VerdictReply result{.sha256 = in.digest("sha256")};
  const std::string word = text(in, "verdict", 16);
  if (word == "accepted") {
    result.kind = VerdictReply::Kind::accepted;
  } else if (word == "rejected") {
    result.kind = VerdictReply::Kind::rejected;
    result.code = reason(in);
  } else if (word == "duplicate") {
    result.kind = VerdictReply::Kind::duplicate;
  } else if (word != "pending") {
    in.refuse("verdict", "accepted, rejected, duplicate or pending", word);
  }
  result.detail = detail(in);
  return result;
}

}  // namespace

AnnouncementReply parse_announcement(std::string_view body) {
  const json document = parse(body);
  const JsonMembers in = members_of(document, "the announcement's answer");
  AnnouncementReply result;
  result.upload = upload_id(in);
  result.missing = digests(in, "missing");
  result.known = digests(in, "known");
  for (const json& item : list(in, "refused")) {
    const JsonMembers tile = members_of(item, "refused");
    result.refused.push_back({tile.digest("sha256"), reason(tile), detail(tile)});
  }
  result.part_max = static_cast<std::uint64_t>(in.whole("part_max", kLeastPart, kMaxPackSize));
  const auto expires_at = parse_utc(text(in, "expires_at", 32));
  if (!expires_at) in.refuse("expires_at", "a time like 2030-01-01T00:00:00Z", in.text("expires_at"));
  result.expires_at = *expires_at;
  return result;
}

StatusReply parse_upload_status(std::string_view body) {
  const json document = parse(body);
  const JsonMembers in = members_of(document, "the upload's status");
  StatusReply result{.upload = upload_id(in), .batch = text(in, "batch", 64)};
  const std::string state = text(in, "state", 16);
  if (state != "open" && state != "judging" && state != "judged") {
    in.refuse("state", "open, judging or judged", state);
  }
  result.complete = state != "open";
  for (const json& item : list(in, "tiles")) result.tiles.push_back(verdict(members_of(item, "tiles")));
  return result;
}

std::string problem_text(std::string_view body) {
  try {
    const json document = parse(body);
    const JsonMembers in = members_of(document, "a problem");
    const std::string title = text(in, "title", kLongestDetail);
    return printable(fmt::format("{}: {}", title, text(in, "detail", kLongestDetail)));
  } catch (const Error&) {
    return body.empty() ? "without words" : "with words that are no problem document";
  }
}

}  // namespace nadir
