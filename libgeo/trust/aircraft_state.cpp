#include "trust/aircraft_state.hpp"

#include <algorithm>
#include <nlohmann/json.hpp>

#include "base/error.hpp"
#include "base/files.hpp"
#include "base/json.hpp"
#include "trust/root.hpp"

namespace nadir {
namespace {

using nlohmann::json;

constexpr const char* kSchema = "nadir.state/1";

struct Refusal {
  std::string expected;
  std::string found;
};

bool counts(const json& value) {
  return value.is_number_unsigned() && value.get<std::uint64_t>() <= (std::uint64_t{1} << 53);
}

std::map<std::int64_t, std::string> read_roots(const json& object) {
  if (!object.is_object()) throw Refusal{"an object by version as roots", object.type_name()};
  std::map<std::int64_t, std::string> roots;
  for (const auto& [version, document] : object.items()) {
    std::string text = document.dump();
    const SignedRoot root = parse_root(text, "root " + version);
    if (std::to_string(root.root.version) != version) throw Refusal{"root version " + version, "another version"};
    roots.emplace(root.root.version, std::move(text));
  }
  return roots;
}

AircraftState read(const json& document) {
  AircraftState state;
  const bool form = document.is_object() && document.value("schema", json()) == kSchema &&
                    document.contains("series") && document["series"].is_object() &&
                    document.contains("root_version") && counts(document["root_version"]) &&
                    document.contains("last_trusted_time") && document.size() == (document.contains("roots") ? 5U : 4U);
  if (!form) {
    throw Refusal{"an object with schema, series, root_version, last_trusted_time and perhaps roots",
                  "another document"};
  }
  for (const auto& [series, sequence] : document["series"].items()) {
    if (!counts(sequence)) throw Refusal{"whole numbers as sequences", sequence.dump()};
    state.highest_sequence[series] = sequence.get<std::int64_t>();
  }
  state.root_version = document["root_version"].get<std::int64_t>();
  const json& time = document["last_trusted_time"];
  if (!time.is_null()) {
    if (time.is_string()) state.last_trusted_time = parse_utc(time.get<std::string>());
    if (!state.last_trusted_time) throw Refusal{"a time as last_trusted_time", time.dump()};
  }
  if (document.contains("roots")) state.roots = read_roots(document["roots"]);
  return state;
}

Finding corrupt(std::string_view name, std::string expected, std::string found) {
  return {.code = "state.corrupt",
          .where = std::string(name),
          .expected = std::move(expected),
          .found = std::move(found),
          .fix = "bring back the aircraft's own file; removing it forgets which packages it has seen"};
}

}  // namespace

void AircraftState::accept(const std::string& series, std::int64_t sequence, std::int64_t root, UtcTime at,
                           const std::map<std::int64_t, std::string>& newer_roots) {
  std::int64_t& highest = highest_sequence[series];
  highest = std::max(highest, sequence);
  root_version = std::max(root_version, root);
  last_trusted_time = std::max(last_trusted_time.value_or(at), at);
  roots.insert(newer_roots.begin(), newer_roots.end());
}

StateReading parse_state(std::string_view text, std::string_view name) {
  StateReading reading;
  try {
    reading.state = read(parse_json(text, name, {.max_depth = 12, .allow_floats = false}));
  } catch (const Refusal& refusal) {
    reading.findings.add(corrupt(name, refusal.expected, refusal.found));
  } catch (const Error& error) {
    reading.findings.add(corrupt(name, error.text().expected.empty() ? "strict JSON" : error.text().expected,
                                 error.text().found.empty() ? error.text().what : error.text().found));
  }
  return reading;
}

StateReading check_state(const std::filesystem::path& path) {
  const auto status = std::filesystem::symlink_status(path);
  if (!std::filesystem::exists(status)) return {AircraftState{}, {}};
  if (std::filesystem::is_regular_file(status) && std::filesystem::file_size(path) > kMaxStateSize) {
    StateReading reading;
    reading.findings.add(corrupt(path.string(), "at most " + std::to_string(kMaxStateSize) + " bytes",
                                 std::to_string(std::filesystem::file_size(path)) + " bytes"));
    return reading;
  }
  return parse_state(read_text_file(path, kMaxStateSize), path.string());
}

AircraftState read_state(const std::filesystem::path& path) {
  StateReading reading = check_state(path);
  if (reading.state) return std::move(*reading.state);
  const Finding& first = reading.findings.items().front();
  throw Error({.what = "this is no state of an aircraft",
               .where = first.where,
               .expected = first.expected,
               .found = first.found,
               .fix = first.fix});
}

void write_state(const std::filesystem::path& path, const AircraftState& state) {
  json document{{"schema", kSchema},
                {"series", json(state.highest_sequence)},
                {"root_version", state.root_version},
                {"last_trusted_time", state.last_trusted_time ? json(to_rfc3339(*state.last_trusted_time)) : json()}};
  for (const auto& [version, text] : state.roots) document["roots"][std::to_string(version)] = json::parse(text);
  write_file_atomic(path, document.dump(1) + "\n");
}

}  // namespace nadir
