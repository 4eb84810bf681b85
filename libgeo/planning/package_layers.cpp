#include "planning/package_layers.hpp"

#include <algorithm>
#include <cmath>
#include <map>
#include <nlohmann/json.hpp>

#include "base/error.hpp"
#include "base/files.hpp"
#include "package/mission_check.hpp"
#include "package/tile_container.hpp"
#include "package/vector_layer.hpp"
#include "vision/place_index_files.hpp"

namespace nadir {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;

constexpr std::int64_t kSecondsOfDay = 86'400;
constexpr std::uint64_t kMaxMissionText = std::uint64_t{1} << 20;

double rounded_to(double value, double steps) { return std::round(value * steps) / steps; }

json ring_json(const TileKey& key, const PixelRing& ring) {
  json points = json::array();
  for (const PixelCorner& corner : ring) {
    const LonLat place = place_of(key, corner);
    // 1e-8 degrees are a millimetre; pixels of zoom 22 are 4 cm
    points.push_back({rounded_to(place.lon_deg, 1e8), rounded_to(place.lat_deg, 1e8)});
  }
  return points;
}

json polygon_json(const TileKey& key, const PixelPolygon& polygon) {
  json rings = json::array({ring_json(key, polygon.outer)});
  for (const PixelRing& hole : polygon.holes) rings.push_back(ring_json(key, hole));
  return rings;
}

// RFC 7946: WGS84 longitude first, outer rings counter-clockwise.
json outline_json(const TileKey& key) {
  return polygon_json(key,
                      {.outer = {{0, 0}, {0, kTileSize}, {kTileSize, kTileSize}, {kTileSize, 0}, {0, 0}}, .holes = {}});
}

struct TileFacts {
  UtcTime captured_at;
  std::int64_t gsd_mm = 0, ce90_mm = 0;
  std::string source, sector;
  TileTrust trust = TileTrust::service;
  double valid = 0;  // share of the tile, in tiles of its own zoom
  std::array<std::size_t, 4> classes{};

  void add(const Sidecar& tile, double share, MatchClass match) {
    const bool first = valid == 0;
    captured_at = first ? tile.captured_at : std::min(captured_at, tile.captured_at);
    gsd_mm = std::max(gsd_mm, tile.gsd_mm), ce90_mm = std::max(ce90_mm, tile.ce90_mm);
    if (first) source = tile.source, sector = tile.sector;
    trust = std::max(trust, tile.trust);
    valid += share * static_cast<double>(tile.valid_ppm) / static_cast<double>(kWholeTile_ppm);
    ++classes.at(static_cast<std::size_t>(match));
  }
  // The most frequent one of those that were evaluated.
  json match() const {
    const auto most = std::max_element(classes.begin() + 1, classes.end());
    if (*most == 0) return {};
    static constexpr std::array<const char*, 4> kNames{"outside", "good", "weak", "poor"};
    return kNames.at(static_cast<std::size_t>(most - classes.begin()));
  }
};

LonLat middle_of(const TileKey& key) { return place_of(key, {kTileSize / 2, kTileSize / 2}); }

}  // namespace

bool PlannedPackage::indexed() const { return manifest.artifact(kRolePlaceIndex) != nullptr; }

PlannedPackage open_planned_package(const fs::path& folder) {
  PlannedPackage package;
  package.folder = folder;
  ManifestReading reading = parse_manifest(read_file(folder / kManifestFile, kMaxManifestSize));
  if (!reading.manifest) {
    throw Error({.what = "cannot read the manifest", .found = reading.findings.items().front().found});
  }
  package.manifest = *std::move(reading.manifest);
  package.mission_text = read_text_file(folder / kMissionFile, kMaxMissionText);
  MissionReading mission = parse_mission(package.mission_text, "mission.yaml");
  if (!mission.mission) throw Error({.what = "the package's mission cannot be read"});
  package.mission = *std::move(mission.mission);
  package.is_signed = fs::is_regular_file(folder / kSignatureFile);
  for (const Artifact& artifact : package.manifest.artifacts) package.bytes += artifact.size;
  const Artifact* const imagery = package.manifest.artifact(kRoleImagery);
  if (imagery == nullptr) throw Error({.what = "the package has no imagery"});
  package.tiles = open_tile_source(folder / imagery->path);
  const auto container = open_tile_container(folder / imagery->path);
  if (container->sidecars() != nullptr) package.sidecars = read_sidecars(*container->sidecars()).sidecars;
  if (package.manifest.artifact(kRoleMatchability) != nullptr) {
    package.matchability =
        parse_matchability_raster(read_file(folder / kMatchabilityFile, kMaxMatchabilityFile), kMatchabilityFile);
  }
  return package;
}

std::optional<Bytes> vectors_of(const PlannedPackage& package) {
  const Artifact* const artifact = package.manifest.artifact(kRoleVectors);
  if (artifact == nullptr || artifact->size > kMaxVectors_bytes) return std::nullopt;
  Bytes bytes = read_file(package.folder / artifact->path, kMaxVectors_bytes);
  if (sha256(bytes) != artifact->sha256) return std::nullopt;
  return bytes;
}

json tiles_geojson(const PlannedPackage& package, UtcTime at, std::size_t most) {
  const int finest = package.mission.zoom.max;
  std::map<TileKey, TileFacts> facts;
  int zoom = finest;
  for (;; --zoom) {
    facts.clear();
    const double share = std::pow(0.25, finest - zoom);
    for (const Sidecar& tile : package.sidecars) {
      if (tile.key.z != finest) continue;
      const MatchClass match =
          package.matchability ? package.matchability->at(middle_of(tile.key)) : MatchClass::outside;
      TileKey key = tile.key;
      while (key.z > zoom) key = key.parent();
      facts[key].add(tile, share, match);
    }
    if (facts.size() <= most || zoom == 0) break;
  }
  json features = json::array();
  for (const auto& [key, tile] : facts) {
    features.push_back({{"type", "Feature"},
                        {"geometry", {{"type", "Polygon"}, {"coordinates", outline_json(key)}}},
                        {"properties",
                         {{"tile", to_text(key)},
                          {"captured_at", to_rfc3339(tile.captured_at)},
                          {"age_days", (at.unix_s - tile.captured_at.unix_s) / kSecondsOfDay},
                          {"gsd_m", static_cast<double>(tile.gsd_mm) / 1000},
                          {"ce90_m", static_cast<double>(tile.ce90_mm) / 1000},
                          {"source", tile.source},
                          {"sector", tile.sector.empty() ? json() : json(tile.sector)},
                          {"trust", name_of(tile.trust)},
                          {"valid", rounded_to(tile.valid, 1000)},
                          {"matchability", tile.match()}}}});
  }
  return {{"type", "FeatureCollection"}, {"features", std::move(features)}};
}

namespace {

json geometry_json(const TileKey& key, const std::vector<PixelPolygon>& outlines) {
  json polygons = json::array();
  for (const PixelPolygon& polygon : outlines) polygons.push_back(polygon_json(key, polygon));
  const bool one = polygons.size() == 1;
  return {{"type", one ? "Polygon" : "MultiPolygon"}, {"coordinates", one ? polygons[0] : polygons}};
}

}  // namespace

json pixels_geojson(const TileKey& key, ByteView mask) { return geometry_json(key, outlines_of(mask)); }

json gaps_geojson(const std::vector<Gap>& gaps, const Mission& mission, std::span<const Sidecar> tiles) {
  const LocalFrame frame = mission_frame(mission);
  json features = json::array();
  for (const Gap& gap : gaps) {
    const Sector* sector = governing_sector(mission, frame, gap.key);
    features.push_back({{"type", "Feature"},
                        {"geometry", geometry_json(gap.key, outlines_of(gap, mission, tiles))},
                        {"properties",
                         {{"tile", to_text(gap.key)},
                          {"zoom", gap.key.z},
                          {"reason", gap.whole_tile ? "no tile" : "empty pixels"},
                          {"area_m2", rounded_to(gap.area_m2, 10)},
                          {"sector", sector == nullptr ? json() : json(sector->id)}}}});
  }
  return {{"type", "FeatureCollection"}, {"features", std::move(features)}};
}

json gaps_geojson(const PlannedPackage& package, const Mission& mission) {
  return gaps_geojson(find_gaps(mission, package.sidecars, mission.zoom.max), mission, package.sidecars);
}

}  // namespace nadir
