#include "catalogue/catalogue_geometry.hpp"

#include <ogr_geometry.h>

#include "base/error.hpp"
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

GeometryHandle unite(const GeoArea& polygons) {
  const QuietGdal quiet;
  const GeometryHandle parts = area_geometry(polygons);
  if (polygons.empty()) return area_geometry({});
  GeometryHandle united(parts->UnionCascaded());
  if (!united) throw Error({.what = "areas cannot be united", .found = QuietGdal::last_error()});
  return united;
}

}  // namespace nadir
