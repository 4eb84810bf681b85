#include "commands/cache/gaps_geojson.hpp"

#include <cmath>
#include <nlohmann/json.hpp>

#include "package/mission_check.hpp"

namespace nadir {
namespace {

using nlohmann::json;

double rounded(double value, double steps) { return std::round(value * steps) / steps; }

json ring_json(const TileKey& key, const PixelRing& ring) {
  json points = json::array();
  for (const PixelCorner& corner : ring) {
    const LonLat place = place_of(key, corner);
    // 1e-8 degrees are a millimetre; pixels of zoom 22 are 4 cm
    points.push_back({rounded(place.lon_deg, 1e8), rounded(place.lat_deg, 1e8)});
  }
  return points;
}

json polygon_json(const TileKey& key, const PixelPolygon& polygon) {
  json rings = json::array({ring_json(key, polygon.outer)});
  for (const PixelRing& hole : polygon.holes) rings.push_back(ring_json(key, hole));
  return rings;
}

}  // namespace

json gaps_geojson(const std::vector<Gap>& gaps, const Mission& mission, std::span<const Sidecar> tiles) {
  const LocalFrame frame = mission_frame(mission);
  json features = json::array();
  for (const Gap& gap : gaps) {
    json polygons = json::array();
    for (const PixelPolygon& polygon : outlines_of(gap, mission, tiles)) {
      polygons.push_back(polygon_json(gap.key, polygon));
    }
    const Sector* sector = governing_sector(mission, frame, gap.key);
    const bool one = polygons.size() == 1;
    features.push_back(
        {{"type", "Feature"},
         {"geometry", {{"type", one ? "Polygon" : "MultiPolygon"}, {"coordinates", one ? polygons[0] : polygons}}},
         {"properties",
          {{"tile", to_text(gap.key)},
           {"zoom", gap.key.z},
           {"reason", gap.whole_tile ? "no tile" : "empty pixels"},
           {"area_m2", rounded(gap.area_m2, 10)},
           {"sector", sector == nullptr ? json() : json(sector->id)}}}});
  }
  return {{"type", "FeatureCollection"}, {"features", std::move(features)}};
}

}  // namespace nadir
