// The parser is strict: it refuses members that this version does not know, except those whose names begin with "x-",
// which are notes for people.
#include "package/manifest.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <nlohmann/json.hpp>

#include "base/error.hpp"
#include "base/fs_verity.hpp"
#include "base/json.hpp"

namespace nadir {
namespace {

using nlohmann::json;

constexpr std::size_t kMaxArtifacts = 1000, kMaxSources = 1000;
constexpr std::uint64_t kMaxInteger = std::uint64_t{1} << 53;  // every JSON reader keeps these exact
constexpr JsonLength kTextLength{1, 64};
constexpr JsonLength kAttributionLength{1, kMaxAttribution};
constexpr std::string_view kNotePrefix = "x-";

bool is_path_character(char c) {
  return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '.' || c == '_' || c == '-';
}

// Two names that are one name on a file system without upper and lower case fold to the same text.
std::string case_fold(std::string_view path) {
  std::string folded(path);
  for (char& c : folded) {
    if (c >= 'A' && c <= 'Z') c = static_cast<char>(c - 'A' + 'a');
  }
  return folded;
}

UtcTime canonical_time(const JsonReader& in, const char* key) {
  const auto time = parse_utc(in.text(key, kTextLength));
  if (!time || to_rfc3339(*time) != in.text(key)) in.refuse(key, "a time like 2024-10-30T00:00:00Z");
  return *time;
}

std::vector<std::string> read_airframes(const JsonReader& list) {
  std::vector<std::string> names;
  for (std::size_t i = 0; i < list.size(); ++i) names.push_back(list.text(i, kTextLength));
  return names;
}

// West, south, east, north.
LonLatBox read_bounds(const JsonReader& list) {
  const auto degrees = [&](std::size_t i, std::int64_t limit_e7) {
    return static_cast<double>(list.integer(i, -limit_e7, limit_e7)) / 1e7;
  };
  constexpr std::int64_t kMaxLon_e7 = 1'800'000'000, kMaxLat_e7 = 900'000'000;
  return {degrees(0, kMaxLon_e7), degrees(1, kMaxLat_e7), degrees(2, kMaxLon_e7), degrees(3, kMaxLat_e7)};
}

SourceLicence read_source(const JsonReader& in) {
  SourceLicence source;
  source.source = in.text("source", {1, 4096});
  source.licence = in.text("licence", kTextLength);
  if (in.has("attribution")) source.attribution = in.text("attribution", kAttributionLength);
  in.finish(kNotePrefix);
  return source;
}

TileSetFacts read_tile_set(const JsonReader& in) {
  TileSetFacts facts;
  facts.count = in.integer<std::uint64_t>("count", 0, kMaxInteger);
  facts.merkle_root = in.digest("merkle_root");
  facts.sidecars_sha256 = in.digest("sidecars_sha256");
  facts.zoom.min = in.integer<int>("zoom_min", 0, kMaxZoom);
  facts.zoom.max = in.integer<int>("zoom_max", 0, kMaxZoom);
  if (facts.zoom.min > facts.zoom.max) in.refuse("zoom_min not above zoom_max");
  facts.format = in.choice("format", {"jpeg", "png", "webp"});
  if (const auto sources = in.optional_array("sources", {1, kMaxSources})) {
    for (std::size_t i = 0; i < sources->size(); ++i) facts.sources.push_back(read_source(sources->object(i)));
    if (!std::is_sorted(facts.sources.begin(), facts.sources.end())) in.refuse("sources", "sources in their order");
  }
  in.finish(kNotePrefix);
  return facts;
}

VectorFacts read_vectors(const JsonReader& in) {
  VectorFacts facts;
  facts.attribution = in.text("attribution", kAttributionLength);
  facts.licence = in.text("licence", kTextLength);
  facts.source_sha256 = in.digest("source_sha256");
  facts.roads = in.integer<std::uint64_t>("roads", 0, kMaxInteger);
  facts.water = in.integer<std::uint64_t>("water", 0, kMaxInteger);
  facts.woods = in.integer<std::uint64_t>("woods", 0, kMaxInteger);
  facts.buildings = in.integer<std::uint64_t>("buildings", 0, kMaxInteger);
  in.finish(kNotePrefix);
  return facts;
}

Artifact read_artifact(const JsonReader& in) {
  Artifact artifact;
  artifact.path = in.text("path", {1, 4096});
  artifact.role = in.text("role", kTextLength);
  artifact.size = in.integer<std::uint64_t>("size", 0, kMaxInteger);
  artifact.sha256 = in.digest("sha256");
  if (artifact.role == kRoleImagery && in.has("fsverity")) artifact.fsverity = in.digest("fsverity");
  if (const auto tiles = in.optional_object("tiles")) artifact.tiles = read_tile_set(*tiles);
  if (const auto vectors = in.optional_object("vectors")) artifact.vectors = read_vectors(*vectors);
  in.finish(kNotePrefix);
  return artifact;
}

Manifest read_manifest(const JsonReader& in) {
  in.expect("schema", kManifestSchema);
  Manifest manifest;
  const JsonReader mission = in.object("mission");
  manifest.mission_id = mission.text("id", kTextLength);
  manifest.series = mission.text("series", kTextLength);
  manifest.sequence = mission.integer("sequence", 0, static_cast<std::int64_t>(kMaxInteger));
  mission.finish(kNotePrefix);
  manifest.created = canonical_time(in, "created");
  manifest.expires = canonical_time(in, "expires");
  manifest.airframes = read_airframes(in.array("airframes", {1, 256}));
  manifest.bounds = read_bounds(in.array("bounds_e7", {4, 4}));
  const JsonReader artifacts = in.array("artifacts", {0, kMaxArtifacts});
  for (std::size_t i = 0; i < artifacts.size(); ++i) manifest.artifacts.push_back(read_artifact(artifacts.object(i)));
  in.finish(kNotePrefix);
  return manifest;
}

Findings check_paths(const Manifest& manifest) {
  Findings findings;
  const auto report = [&findings](std::size_t i, const std::string& path, std::string found) {
    findings.add({.code = "manifest.path",
                  .where = fmt::format("manifest.json /artifacts/{}/path \"{}\"", i, path),
                  .expected = "a relative name inside the package that no other artifact has",
                  .found = std::move(found),
                  .fix = "get the package again from its producer"});
  };
  std::map<std::string, std::string> seen{{std::string(kManifestFile), std::string(kManifestFile)},
                                          {std::string(kSignatureFile), std::string(kSignatureFile)}};
  for (std::size_t i = 0; i < manifest.artifacts.size(); ++i) {
    const std::string& path = manifest.artifacts[i].path;
    if (const auto problem = path_problem(path)) {
      report(i, path, *problem);
      continue;
    }
    const auto [twin, is_new] = seen.emplace(case_fold(path), path);
    if (!is_new) report(i, path, "the same name as \"" + twin->second + "\" except for upper and lower case");
  }
  return findings;
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
      if (!is_path_character(c)) return "a character other than letters, digits, '.', '_' and '-'";
    }
    begin = end + 1;
  }
  return std::nullopt;
}

ManifestReading parse_manifest(ByteView bytes) {
  ManifestReading reading;
  const auto refuse = [&reading](std::string where, std::string expected, std::string found) {
    reading.findings.add({.code = "manifest.schema",
                          .where = std::move(where),
                          .expected = std::move(expected),
                          .found = std::move(found),
                          .fix = "build the package again with this version"});
  };
  if (bytes.size() > kMaxManifestSize) {
    refuse(std::string(kManifestFile), fmt::format("at most {} bytes", kMaxManifestSize),
           fmt::format("{} bytes", bytes.size()));
    return reading;
  }
  try {
    const json document = parse_json(as_text(bytes), kManifestFile, {.max_depth = 8, .allow_floats = false});
    const JsonReader in(document, {.name = std::string(kManifestFile), .what = "cannot accept this manifest"});
    Manifest manifest = read_manifest(in);
    reading.findings.add(check_paths(manifest));
    if (reading.findings.empty()) reading.manifest = std::move(manifest);
  } catch (const JsonError& error) {
    refuse(error.text().where, error.text().expected, error.text().found);
  } catch (const Error& error) {
    refuse(std::string(kManifestFile), "strict JSON",
           error.text().found.empty() ? error.text().what : error.text().found);
  }
  return reading;
}

namespace {

using nlohmann::json;

json to_json(const Artifact& artifact) {
  json object{
      {"path", artifact.path}, {"role", artifact.role}, {"size", artifact.size}, {"sha256", artifact.sha256.hex()}};
  if (artifact.fsverity) object["fsverity"] = artifact.fsverity->hex();
  if (artifact.tiles) {
    object["tiles"] = {{"count", artifact.tiles->count},
                       {"merkle_root", artifact.tiles->merkle_root.hex()},
                       {"sidecars_sha256", artifact.tiles->sidecars_sha256.hex()},
                       {"zoom_min", artifact.tiles->zoom.min},
                       {"zoom_max", artifact.tiles->zoom.max},
                       {"format", artifact.tiles->format}};
    for (const SourceLicence& source : artifact.tiles->sources) {
      json item{{"source", source.source}, {"licence", source.licence}};
      if (!source.attribution.empty()) item["attribution"] = source.attribution;
      object["tiles"]["sources"].push_back(std::move(item));
    }
  }
  if (artifact.vectors) {
    const VectorFacts& vectors = *artifact.vectors;
    object["vectors"] = {{"attribution", vectors.attribution},
                         {"licence", vectors.licence},
                         {"source_sha256", vectors.source_sha256.hex()},
                         {"roads", vectors.roads},
                         {"water", vectors.water},
                         {"woods", vectors.woods},
                         {"buildings", vectors.buildings}};
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
  // The sides of the plane's box are curves in degrees: its corners and the middles of its sides bound it well enough.
  LonLatBox& bounds = manifest.bounds = {180, 90, -180, -90};
  for (const double east_m : {box.west_m, (box.west_m + box.east_m) / 2, box.east_m}) {
    for (const double north_m : {box.south_m, (box.south_m + box.north_m) / 2, box.north_m}) {
      const LonLat place = frame.lonlat_from_plane({east_m, north_m});
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
  if (role == kRoleImagery) {
    const FileDigests digests = digests_of(InputFile(file));
    artifact.sha256 = digests.sha256;
    artifact.fsverity = digests.verity;
  } else {
    artifact.sha256 = sha256_file(file);
  }
  std::error_code error;
  artifact.size = std::filesystem::file_size(file, error);
  if (error)
    throw Error({.what = "cannot read the size of a package file",
                 .where = file,
                 .found = error.message(),
                 .fix = "check the permissions of the package and the storage medium"});
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
