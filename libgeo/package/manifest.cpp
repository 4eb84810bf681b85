#include "package/manifest.hpp"

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include "base/error.hpp"

namespace nadir {
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
