// Parsing guesses nothing: whatever this version does not know, it refuses, except members whose names begin with "x-",
// which are notes for people.
#include "package/manifest.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <nlohmann/json.hpp>

#include "base/error.hpp"
#include "base/json.hpp"

namespace nadir {

namespace {

bool allowed(char c) {
  return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '.' || c == '_' || c == '-';
}

}  // namespace

std::optional<std::string> path_problem(std::string_view path) {
  if (path.empty()) return "an empty name";
  if (path.size() > kMaxPackagePath) return "a name of more than " + std::to_string(kMaxPackagePath) + " characters";
  if (path.front() == '/') return "an absolute path";
  std::size_t begin = 0;
  while (begin <= path.size()) {
    const std::size_t end = std::min(path.find('/', begin), path.size());
    const std::string_view part = path.substr(begin, end - begin);
    if (part.empty()) return "an empty part between slashes";
    if (part == "..") return "\"..\", which leads out of the package";
    if (part.front() == '.') return "a part that begins with a dot";
    for (const char c : part) {
      if (!allowed(c)) return "a character other than letters, digits, '.', '_' and '-'";
    }
    begin = end + 1;
  }
  return std::nullopt;
}

std::string case_fold(std::string_view path) {
  std::string folded(path);
  for (char& c : folded) {
    if (c >= 'A' && c <= 'Z') c = static_cast<char>(c - 'A' + 'a');
  }
  return folded;
}

namespace {

using nlohmann::json;

constexpr std::uint64_t kMaxWhole = std::uint64_t{1} << 53;  // every JSON reader keeps these exact
constexpr std::size_t kMaxArtifacts = 1000;
constexpr std::size_t kMaxText = 64;

// Thrown inside this file only; becomes a finding.
struct Refusal {
  std::string where, expected, found;
};

std::string shown(const json& value) {
  std::string text = value.dump(-1, ' ', true, json::error_handler_t::replace);
  if (text.size() > 80) text = text.substr(0, 77) + "...";
  return text;
}

const json& member(const json& object, const char* name, const std::string& where) {
  const auto found = object.find(name);
  if (found == object.end()) throw Refusal{where, fmt::format("a member \"{}\"", name), "none"};
  return *found;
}

void require_object(const json& value, const std::string& where, std::initializer_list<std::string_view> known) {
  if (!value.is_object()) throw Refusal{where, "an object", shown(value)};
  for (const auto& [name, ignored] : value.items()) {
    if (name.starts_with("x-") || std::find(known.begin(), known.end(), name) != known.end()) continue;
    throw Refusal{where, "only members that this version knows", fmt::format("\"{}\"", name.substr(0, 80))};
  }
}

std::string text(const json& object, const char* name, const std::string& where, std::size_t longest = kMaxText) {
  const json& value = member(object, name, where);
  const auto* string = value.get_ptr<const std::string*>();
  if (string == nullptr || string->empty() || string->size() > longest) {
    throw Refusal{where + "/" + name, fmt::format("text of 1 to {} bytes", longest), shown(value)};
  }
  return *string;
}

std::uint64_t whole(const json& object, const char* name, const std::string& where, std::uint64_t highest = kMaxWhole) {
  const json& value = member(object, name, where);
  if (!value.is_number_unsigned() || value.get<std::uint64_t>() > highest) {
    throw Refusal{where + "/" + name, fmt::format("a whole number from 0 to {}", highest), shown(value)};
  }
  return value.get<std::uint64_t>();
}

Sha256 digest(const json& object, const char* name, const std::string& where) {
  const auto value = Sha256::from_hex(text(object, name, where));
  if (!value) throw Refusal{where + "/" + name, "64 lower-case hexadecimal digits", shown(object[name])};
  return *value;
}

UtcTime time(const json& object, const char* name, const std::string& where) {
  const std::string value = text(object, name, where);
  const auto parsed = parse_utc(value);
  if (!parsed || to_rfc3339(*parsed) != value) {
    throw Refusal{where + "/" + name, "a time like 2024-10-30T00:00:00Z", shown(object[name])};
  }
  return *parsed;
}

std::vector<std::string> airframes(const json& root) {
  const json& list = member(root, "airframes", "");
  if (!list.is_array() || list.empty() || list.size() > 256) {
    throw Refusal{"/airframes", "a list of 1 to 256 names", shown(list)};
  }
  std::vector<std::string> names;
  for (const json& item : list) {
    if (!item.is_string() || item.get<std::string>().empty() || item.get<std::string>().size() > kMaxText) {
      throw Refusal{"/airframes", "names of 1 to 64 bytes", shown(item)};
    }
    names.push_back(item.get<std::string>());
  }
  return names;
}

LonLatBox bounds(const json& root) {
  const json& list = member(root, "bounds_e7", "");
  const bool whole_numbers = list.is_array() && list.size() == 4 &&
                             std::all_of(list.begin(), list.end(), [](const json& v) { return v.is_number_integer(); });
  if (!whole_numbers) throw Refusal{"/bounds_e7", "four whole numbers: west, south, east, north", shown(list)};
  const auto in_range = [&](std::size_t i, std::int64_t limit) {
    const json& value = list[i];
    if (value.is_number_unsigned() && value.get<std::uint64_t>() > static_cast<std::uint64_t>(limit)) return false;
    return value.get<std::int64_t>() >= -limit && value.get<std::int64_t>() <= limit;
  };
  if (!in_range(0, 1'800'000'000) || !in_range(2, 1'800'000'000) || !in_range(1, 900'000'000) ||
      !in_range(3, 900'000'000)) {
    throw Refusal{"/bounds_e7", "longitudes and latitudes in 1e-7 degrees", shown(list)};
  }
  const auto degrees = [&](std::size_t i) { return static_cast<double>(list[i].get<std::int64_t>()) / 1e7; };
  return {degrees(0), degrees(1), degrees(2), degrees(3)};
}

TileSetFacts tile_set(const json& object, const std::string& where) {
  require_object(object, where, {"count", "merkle_root", "sidecars_sha256", "zoom_min", "zoom_max", "format"});
  TileSetFacts facts;
  facts.count = whole(object, "count", where);
  facts.merkle_root = digest(object, "merkle_root", where);
  facts.sidecars_sha256 = digest(object, "sidecars_sha256", where);
  facts.zoom.min = static_cast<int>(whole(object, "zoom_min", where, kMaxZoom));
  facts.zoom.max = static_cast<int>(whole(object, "zoom_max", where, kMaxZoom));
  if (facts.zoom.min > facts.zoom.max) throw Refusal{where, "zoom_min not above zoom_max", shown(object)};
  facts.format = text(object, "format", where);
  if (facts.format != "jpeg" && facts.format != "png" && facts.format != "webp") {
    throw Refusal{where + "/format", "\"jpeg\", \"png\" or \"webp\"", shown(object["format"])};
  }
  return facts;
}

Artifact artifact(const json& object, const std::string& where) {
  require_object(object, where, {"path", "role", "size", "sha256", "tiles"});
  Artifact result;
  result.path = text(object, "path", where, 4096);
  result.role = text(object, "role", where);
  result.size = whole(object, "size", where);
  result.sha256 = digest(object, "sha256", where);
  if (object.contains("tiles")) result.tiles = tile_set(object["tiles"], where + "/tiles");
  return result;
}

Manifest read(const json& root) {
  require_object(root, "", {"schema", "mission", "created", "expires", "airframes", "bounds_e7", "artifacts"});
  if (text(root, "schema", "") != kManifestSchema) {
    throw Refusal{"/schema", fmt::format("\"{}\"", kManifestSchema), shown(root["schema"])};
  }
  Manifest manifest;
  const json& mission = member(root, "mission", "");
  require_object(mission, "/mission", {"id", "series", "sequence"});
  manifest.mission_id = text(mission, "id", "/mission");
  manifest.series = text(mission, "series", "/mission");
  manifest.sequence = static_cast<std::int64_t>(whole(mission, "sequence", "/mission"));
  manifest.created = time(root, "created", "");
  manifest.expires = time(root, "expires", "");
  manifest.airframes = airframes(root);
  manifest.bounds = bounds(root);
  const json& artifacts = member(root, "artifacts", "");
  if (!artifacts.is_array() || artifacts.size() > kMaxArtifacts) {
    throw Refusal{"/artifacts", fmt::format("a list of at most {} artifacts", kMaxArtifacts), artifacts.type_name()};
  }
  for (std::size_t i = 0; i < artifacts.size(); ++i) {
    manifest.artifacts.push_back(artifact(artifacts[i], fmt::format("/artifacts/{}", i)));
  }
  return manifest;
}

Findings check_paths(const Manifest& manifest) {
  Findings findings;
  const auto complain = [&findings](std::size_t i, const std::string& path, std::string found) {
    findings.add({.code = "manifest.path",
                  .where = fmt::format("manifest.json /artifacts/{}/path \"{}\"", i, path),
                  .expected = "a relative name inside the package that no other artifact has",
                  .found = std::move(found)});
  };
  std::map<std::string, std::string> seen{{std::string(kManifestFile), std::string(kManifestFile)},
                                          {std::string(kSignatureFile), std::string(kSignatureFile)}};
  for (std::size_t i = 0; i < manifest.artifacts.size(); ++i) {
    const std::string& path = manifest.artifacts[i].path;
    if (const auto problem = path_problem(path)) {
      complain(i, path, *problem);
      continue;
    }
    const auto [twin, is_new] = seen.emplace(case_fold(path), path);
    if (!is_new) complain(i, path, "the same name as \"" + twin->second + "\" but for upper and lower case");
  }
  return findings;
}

}  // namespace

ManifestReading parse_manifest(ByteView bytes) {
  ManifestReading reading;
  const auto refuse = [&reading](std::string where, std::string expected, std::string found) {
    reading.findings.add({.code = "manifest.schema",
                          .where = "manifest.json " + std::move(where),
                          .expected = std::move(expected),
                          .found = std::move(found),
                          .fix = "build the package again with this version"});
  };
  if (bytes.size() > kMaxManifestSize) {
    refuse("", fmt::format("at most {} bytes", kMaxManifestSize), fmt::format("{} bytes", bytes.size()));
    return reading;
  }
  try {
    Manifest manifest = read(parse_json(as_text(bytes), kManifestFile, {.max_depth = 8, .allow_floats = false}));
    reading.findings.add(check_paths(manifest));
    if (reading.findings.empty()) reading.manifest = std::move(manifest);
  } catch (const Refusal& refusal) {
    refuse(refusal.where, refusal.expected, refusal.found);
  } catch (const Error& error) {
    refuse("", "strict JSON", error.text().found.empty() ? error.text().what : error.text().found);
  }
  return reading;
}

namespace {

using nlohmann::json;

json to_json(const Artifact& artifact) {
  json object{
      {"path", artifact.path}, {"role", artifact.role}, {"size", artifact.size}, {"sha256", artifact.sha256.hex()}};
  if (artifact.tiles) {
    object["tiles"] = {{"count", artifact.tiles->count},
                       {"merkle_root", artifact.tiles->merkle_root.hex()},
                       {"sidecars_sha256", artifact.tiles->sidecars_sha256.hex()},
                       {"zoom_min", artifact.tiles->zoom.min},
                       {"zoom_max", artifact.tiles->zoom.max},
                       {"format", artifact.tiles->format}};
  }
  return object;
}

}  // namespace

const Artifact* Manifest::artifact(std::string_view role) const {
  const auto found = std::find_if(artifacts.begin(), artifacts.end(),
                                  [role](const Artifact& artifact) { return artifact.role == role; });
  return found == artifacts.end() ? nullptr : &*found;
}

Manifest manifest_for(const Mission& mission) {
  Manifest manifest;
  manifest.mission_id = mission.id;
  manifest.series = mission.series;
  manifest.sequence = mission.sequence;
  manifest.created = mission.created;
  manifest.expires = mission.expires;
  manifest.airframes = mission.airframes;
  const LocalFrame frame = mission_frame(mission);
  const PlaneBox box = required_region(mission, frame).bounds();
  // The plane's box bulges in degrees: its four corners and the middles of its sides bound it well enough outwards.
  LonLatBox& bounds = manifest.bounds = {180, 90, -180, -90};
  for (const double east_m : {box.west_m, (box.west_m + box.east_m) / 2, box.east_m}) {
    for (const double north_m : {box.south_m, (box.south_m + box.north_m) / 2, box.north_m}) {
      const LonLat place = frame.lonlat_from_enu(east_m, north_m);
      bounds.west_deg = std::min(bounds.west_deg, std::floor(place.lon_deg * 1e7) / 1e7);
      bounds.south_deg = std::min(bounds.south_deg, std::floor(place.lat_deg * 1e7) / 1e7);
      bounds.east_deg = std::max(bounds.east_deg, std::ceil(place.lon_deg * 1e7) / 1e7);
      bounds.north_deg = std::max(bounds.north_deg, std::ceil(place.lat_deg * 1e7) / 1e7);
    }
  }
  return manifest;
}

Artifact describe_file(const std::filesystem::path& package, std::string_view relative_path, std::string_view role) {
  const std::filesystem::path file = package / relative_path;
  Artifact artifact;
  artifact.path = relative_path;
  artifact.role = role;
  artifact.sha256 = sha256_file(file);
  std::error_code error;
  artifact.size = std::filesystem::file_size(file, error);
  if (error) throw Error({.what = "cannot look at a file of the package", .where = file, .found = error.message()});
  return artifact;
}

std::string manifest_json(Manifest manifest) {
  std::sort(manifest.artifacts.begin(), manifest.artifacts.end(),
            [](const Artifact& a, const Artifact& b) { return a.path < b.path; });
  json artifacts = json::array();
  for (const Artifact& artifact : manifest.artifacts) artifacts.push_back(to_json(artifact));
  const json document{
      {"schema", kManifestSchema},
      {"mission", {{"id", manifest.mission_id}, {"series", manifest.series}, {"sequence", manifest.sequence}}},
      {"created", to_rfc3339(manifest.created)},
      {"expires", to_rfc3339(manifest.expires)},
      {"airframes", manifest.airframes},
      {"bounds_e7",
       {std::llround(manifest.bounds.west_deg * 1e7), std::llround(manifest.bounds.south_deg * 1e7),
        std::llround(manifest.bounds.east_deg * 1e7), std::llround(manifest.bounds.north_deg * 1e7)}},
      {"artifacts", artifacts}};
  return document.dump(1) + "\n";
}

}  // namespace nadir
