#include "catalogue/geometry.hpp"

#include <ogr_geometry.h>

#include "base/error.hpp"
#include "geodesy/web_mercator.hpp"
#include "package/coverage_gaps.hpp"
#include "package/tile_image.hpp"
#include "raster/gdal_dataset.hpp"

namespace nadir {
namespace {

void add_rings(OGRPolygon& polygon, const GeoPolygon& rings) {
  for (const GeoRing& points : rings) {
    auto ring = std::make_unique<OGRLinearRing>();
    ring->setNumPoints(static_cast<int>(points.size()), FALSE);
    for (std::size_t i = 0; i < points.size(); ++i) {
      ring->setPoint(static_cast<int>(i), points[i].lon_deg, points[i].lat_deg);
    }
    polygon.addRingDirectly(ring.release());
  }
}

GeoPolygon polygon_from(const OGRPolygon& polygon) {
  GeoPolygon rings;
  for (const OGRLinearRing* ring : polygon) {
    GeoRing points;
    for (int i = 0; i < ring->getNumPoints(); ++i) points.push_back({ring->getX(i), ring->getY(i)});
    rings.push_back(std::move(points));
  }
  return rings;
}

void collect(const OGRGeometry& geometry, GeoArea& area) {
  switch (wkbFlatten(geometry.getGeometryType())) {
    case wkbPolygon:
      if (!geometry.IsEmpty()) area.push_back(polygon_from(*geometry.toPolygon()));
      break;
    case wkbMultiPolygon:
    case wkbGeometryCollection:
      for (const OGRGeometry* part : *geometry.toGeometryCollection()) collect(*part, area);
      break;
    default: break;
  }
}

}  // namespace

void DeleteGeometry::operator()(OGRGeometry* geometry) const { OGRGeometryFactory::destroyGeometry(geometry); }

GeometryHandle polygon_geometry(const GeoPolygon& polygon) {
  auto geometry = std::make_unique<OGRPolygon>();
  add_rings(*geometry, polygon);
  return GeometryHandle(geometry.release());
}

GeometryHandle area_geometry(const GeoArea& area) {
  auto geometry = std::make_unique<OGRMultiPolygon>();
  for (const GeoPolygon& polygon : area) {
    auto part = std::make_unique<OGRPolygon>();
    add_rings(*part, polygon);
    geometry->addGeometryDirectly(part.release());
  }
  return GeometryHandle(geometry.release());
}

GeometryHandle line_geometry(const std::vector<LonLat>& points) {
  auto line = std::make_unique<OGRLineString>();
  for (const LonLat& point : points) line->addPoint(point.lon_deg, point.lat_deg);
  return GeometryHandle(line.release());
}

GeoArea area_from(const OGRGeometry& geometry) {
  GeoArea area;
  collect(geometry, area);
  return area;
}

GeometryHandle union_of(const GeoArea& polygons) {
  const QuietGdal quiet;
  const GeometryHandle parts = area_geometry(polygons);
  if (polygons.empty()) return area_geometry({});
  GeometryHandle united(parts->UnionCascaded());
  if (!united) throw Error({.what = "the union of areas failed", .found = QuietGdal::last_error()});
  return united;
}

namespace {

constexpr int kQuarterCircle = 16;  // segments: 0.2 % of the half width

GeoPolygon closed(std::vector<LonLat> ring) {
  ring.push_back(ring.front());
  return {std::move(ring)};
}

// A shape in metres of the plane, widened.
GeoPolygon buffered_area(const OGRGeometry& shape, double by_m, const LocalFrame& frame, const std::string& where) {
  const GeometryHandle buffered(shape.Buffer(by_m, kQuarterCircle));
  GeoArea area = buffered ? area_from(*buffered) : GeoArea();
  if (area.size() != 1) throw Error({.what = "a widened shape is not a polygon", .where = where});
  for (GeoRing& ring : area.front()) {
    // GDAL's x and y are metres of the plane here, although area_from() took them for degrees.
    for (LonLat& place : ring) place = frame.lonlat_from_plane({place.lon_deg, place.lat_deg});
  }
  return area.front();
}

// All tiles from `first` to `last`, which is further south in the same column.
GeoPolygon column_area(const TileKey& first, const TileKey& last) {
  const LonLat north_west = place_of(first, {0, 0}), south_east = place_of(last, {kTileSize, kTileSize});
  return closed(
      {north_west, {north_west.lon_deg, south_east.lat_deg}, south_east, {south_east.lon_deg, north_west.lat_deg}});
}

GeoRing ring_from(const TileKey& key, const PixelRing& ring) {
  GeoRing places;
  for (const PixelCorner& corner : ring) places.push_back(place_of(key, corner));
  return places;
}

}  // namespace

GeoPolygon area_of(const TileKey& key) { return column_area(key, key); }

GeoArea area_of(const TileKey& key, std::span<const PixelPolygon> outlines) {
  GeoArea area;
  for (const PixelPolygon& polygon : outlines) {
    GeoPolygon rings{ring_from(key, polygon.outer)};
    for (const PixelRing& hole : polygon.holes) rings.push_back(ring_from(key, hole));
    area.push_back(std::move(rings));
  }
  return area;
}

GeoPolygon corridor_area(const Mission& mission) {
  const LocalFrame frame = mission_frame(mission);
  OGRLineString line;
  for (const PlanePoint& point : to_plane(frame, mission.route.points)) line.addPoint(point.east_m, point.north_m);
  return buffered_area(line, mission.route.corridor_half_width_m, frame, "the route of mission " + mission.id);
}

GeoPolygon sector_area(const Mission& mission, const Sector& sector) {
  if (!(sector.buffer_m > 0)) return closed(sector.polygon);
  const LocalFrame frame = mission_frame(mission);
  OGRLinearRing ring;
  for (const PlanePoint& point : to_plane(frame, sector.polygon)) ring.addPoint(point.east_m, point.north_m);
  ring.closeRings();
  OGRPolygon polygon;
  polygon.addRing(&ring);
  return buffered_area(polygon, sector.buffer_m, frame, "sector " + sector.id);
}

GeoArea mission_area(const Mission& mission) {
  GeoArea parts;
  if (!mission.route.points.empty()) parts.push_back(corridor_area(mission));
  for (const Sector& sector : mission.sectors) parts.push_back(sector_area(mission, sector));
  return area_from(*union_of(parts));
}

GeoArea footprint_of(std::span<const Sidecar* const> tiles) {
  GeoArea parts;
  std::optional<TileKey> first;
  for (std::size_t i = 0; i < tiles.size(); ++i) {
    const TileKey& key = tiles[i]->key;
    if (tiles[i]->valid_ppm == kWholeTile_ppm) {
      // Whole tiles of a column are joined here: a hundred times fewer polygons for GEOS.
      if (!first) first = key;
      const TileKey below{key.z, key.x, key.y + 1};
      const bool continues =
          i + 1 < tiles.size() && tiles[i + 1]->key == below && tiles[i + 1]->valid_ppm == kWholeTile_ppm;
      if (!continues) parts.push_back(column_area(*first, key)), first.reset();
      continue;
    }
    const auto mask = decode_tile_mask(tiles[i]->mask);
    if (!mask) continue;  // nothing is valid
    for (GeoPolygon& polygon : area_of(key, outlines_of(*mask))) parts.push_back(std::move(polygon));
  }
  return area_from(*union_of(parts));
}

}  // namespace nadir
