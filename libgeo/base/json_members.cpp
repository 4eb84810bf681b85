#include "base/json_members.hpp"

#include <fmt/format.h>

#include <nlohmann/json.hpp>

#include "base/error.hpp"

namespace nadir {

using nlohmann::json;

JsonMembers::JsonMembers(const json& object, std::string where, std::size_t members, const Complaint& complaint)
    : object_(object), where_(std::move(where)), complaint_(complaint) {
  if (!object.is_object()) refuse("", "an object", object);
  if (object.size() != members) refuse("", fmt::format("exactly {} members", members), object.size());
}

void JsonMembers::refuse(std::string_view member, std::string expected, const json& found) const {
  // Hostile text: replace what is no UTF-8 rather than throw about it.
  throw Error({.what = complaint_.what,
               .where = fmt::format("{}{}{}", where_, member.empty() ? "" : ": ", member),
               .expected = std::move(expected),
               .found = found.dump(-1, ' ', true, json::error_handler_t::replace).substr(0, 80),
               .fix = complaint_.fix});
}

const json& JsonMembers::member(const char* key) const {
  const auto found = object_.find(key);
  if (found == object_.end()) refuse(key, "this member", nullptr);
  return *found;
}

JsonMembers JsonMembers::object(const char* key, std::size_t members) const {
  return {member(key), fmt::format("{}: {}", where_, key), members, complaint_};
}

const std::string& JsonMembers::text(const char* key) const {
  const json& value = member(key);
  if (!value.is_string()) refuse(key, "text", value);
  return value.get_ref<const std::string&>();
}

double JsonMembers::number(const char* key, double least, double most) const {
  const json& value = member(key);
  const bool fits = value.is_number() && value.get<double>() >= least && value.get<double>() <= most;
  if (!fits) refuse(key, fmt::format("a number from {} to {}", least, most), value);
  return value.get<double>();
}

std::int64_t JsonMembers::whole(const char* key, std::int64_t least, std::int64_t most) const {
  const json& value = member(key);
  const bool fits = value.is_number_integer() &&
                    !(value.is_number_unsigned() && value.get<std::uint64_t>() > std::uint64_t{1} << 62) &&
                    value.get<std::int64_t>() >= least && value.get<std::int64_t>() <= most;
  if (!fits) refuse(key, fmt::format("a whole number from {} to {}", least, most), value);
  return value.get<std::int64_t>();
}

bool JsonMembers::yes_or_no(const char* key) const {
  const json& value = member(key);
  if (!value.is_boolean()) refuse(key, "true or false", value);
  return value.get<bool>();
}

Sha256 JsonMembers::digest(const char* key) const {
  const auto value = Sha256::from_hex(text(key));
  if (!value) refuse(key, "64 lower-case hexadecimal digits", text(key));
  return *value;
}

}  // namespace nadir
