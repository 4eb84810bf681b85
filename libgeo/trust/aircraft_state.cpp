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
constexpr std::int64_t kMaxSequence = std::int64_t{1} << 53;

std::map<std::int64_t, std::string> read_roots(const JsonReader& in) {
  std::map<std::int64_t, std::string> roots;
  for (const std::string& version : in.keys()) {
    std::string text = in.object(version).json().dump();
    const SignedRoot root = parse_root(text, "root " + version);
    if (std::to_string(root.root.version) != version) in.refuse(version, "a root of version " + version);
    roots.emplace(root.root.version, std::move(text));
  }
  return roots;
}

AircraftState read(const JsonReader& in) {
  AircraftState state;
  in.expect("schema", kSchema);
  const JsonReader series = in.object("series");
  for (const std::string& name : series.keys()) {
    state.highest_sequence[name] = series.integer(name, 0, kMaxSequence);
  }
  state.root_version = in.integer("root_version", 0, kMaxSequence);
  if (!in.is_null("last_trusted_time")) state.last_trusted_time = in.time("last_trusted_time");
  if (const auto roots = in.optional_object("roots")) state.roots = read_roots(*roots);
  if (const auto airframes = in.optional_object("airframes")) {
    for (const std::string& id : airframes->keys()) {
      state.airframe_sequence[id] = airframes->integer(id, 0, kMaxSequence);
    }
  }
  in.finish();
  return state;
}

Finding corrupt(std::string_view name, std::string expected, std::string found) {
  return {.code = "state.corrupt",
          .where = std::string(name),
          .expected = std::move(expected),
          .found = std::move(found),
          .fix = "restore the aircraft's own file; without it the aircraft forgets which packages it has accepted"};
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

UtcTime remembered_time(UtcTime clock, UtcTime package_created) {
  return std::min(clock, UtcTime{package_created.unix_s + kMaxTrustedLead_s});
}

void AircraftState::accept_airframe(const std::string& airframe, std::int64_t sequence) {
  std::int64_t& highest = airframe_sequence[airframe];
  highest = std::max(highest, sequence);
}

StateReading parse_state(std::string_view text, std::string_view name) {
  StateReading reading;
  try {
    const json document = parse_json(text, name, {.max_depth = 12, .allow_floats = false});
    reading.state = read(JsonReader(document, {.name = std::string(name), .what = "the aircraft's state is corrupt"}));
  } catch (const Error& error) {
    reading.findings.add(corrupt(error.text().where,
                                 error.text().expected.empty() ? "strict JSON" : error.text().expected,
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
  throw Error({.what = "the aircraft's state is corrupt",
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
  if (!state.airframe_sequence.empty()) document["airframes"] = state.airframe_sequence;
  write_file_atomic(path, document.dump(1) + "\n");
}

}  // namespace nadir
