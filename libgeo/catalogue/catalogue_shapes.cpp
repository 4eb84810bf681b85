#include "catalogue/catalogue_shapes.hpp"

#include <ogr_geometry.h>

#include "base/error.hpp"
#include "geodesy/web_mercator.hpp"
#include "catalogue/catalogue_geometry.hpp"
#include "package/coverage_gaps.hpp"
#include "package/tile_image.hpp"

namespace nadir {
namespace {

constexpr int kQuarterCircle = 16;  // segments: 0.2 % of the half width

GeoPolygon closed(std::vector<LonLat> ring) {
  ring.push_back(ring.front());
  return {std::move(ring)};
}

// All tiles from `first` to `last`, which is further south in the same column.
GeoPolygon column_area(const TileKey& first, const TileKey& last) {
  const LonLat north_west = place_of(first, {0, 0}), south_east = place_of(last, {kTileSize, kTileSize});
  return closed(
      {north_west, {north_west.lon_deg, south_east.lat_deg}, south_east, {south_east.lon_deg, north_west.lat_deg}});
}

GeoRing ring_area(const TileKey& key, const PixelRing& ring) {
  GeoRing places;
  for (const PixelCorner& corner : ring) places.push_back(place_of(key, corner));
  return places;
}

}  // namespace

GeoPolygon area_of(const TileKey& key) { return column_area(key, key); }

GeoPolygon corridor_area(const Mission& mission) {
  const LocalFrame frame = mission_frame(mission);
  OGRLineString line;
  for (const PlanePoint& point : to_plane(frame, mission.route.points)) line.addPoint(point.east_m, point.north_m);
  const GeometryHandle buffered(line.Buffer(mission.route.corridor_half_width_m, kQuarterCircle));
  GeoArea area = buffered ? area_from(*buffered) : GeoArea();
  if (area.size() != 1) throw Error({.what = "the route's corridor cannot be drawn", .where = "mission " + mission.id});
  for (GeoRing& ring : area.front()) {
    for (LonLat& place : ring) place = frame.lonlat_from_enu(place.lon_deg, place.lat_deg);  // was east, north
  }
  return area.front();
}

GeoArea mission_area(const Mission& mission) {
  GeoArea parts{corridor_area(mission)};
  for (const Sector& sector : mission.sectors) parts.push_back(closed(sector.polygon));
  return area_from(*unite(parts));
}

GeoArea footprint_of(std::span<const Sidecar* const> tiles) {
  GeoArea parts;
  std::optional<TileKey> first;
  for (std::size_t i = 0; i < tiles.size(); ++i) {
    const TileKey& key = tiles[i]->key;
    if (tiles[i]->valid_ppm == kWholeTile_ppm) {
      // Whole tiles of a column are joined here: a hundred times less for GEOS to unite.
      if (!first) first = key;
      const TileKey below{key.z, key.x, key.y + 1};
      const bool goes_on =
          i + 1 < tiles.size() && tiles[i + 1]->key == below && tiles[i + 1]->valid_ppm == kWholeTile_ppm;
      if (!goes_on) parts.push_back(column_area(*first, key)), first.reset();
      continue;
    }
    const auto mask = decode_tile_mask(tiles[i]->mask);
    if (!mask) continue;  // nothing is valid
    for (const PixelPolygon& polygon : outlines_of(*mask)) {
      GeoPolygon rings{ring_area(key, polygon.outer)};
      for (const PixelRing& hole : polygon.holes) rings.push_back(ring_area(key, hole));
      parts.push_back(std::move(rings));
    }
  }
  return area_from(*unite(parts));
}

}  // namespace nadir
