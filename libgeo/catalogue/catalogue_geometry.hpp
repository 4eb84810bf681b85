// Between plain areas and GDAL's geometries (GEOS does the set operations).
#pragma once

#include <memory>

#include "catalogue/catalogue_area.hpp"

class OGRGeometry;

namespace nadir {

struct DeleteGeometry {
  void operator()(OGRGeometry* geometry) const;
};
using GeometryHandle = std::unique_ptr<OGRGeometry, DeleteGeometry>;

GeometryHandle polygon_geometry(const GeoPolygon& polygon);
GeometryHandle area_geometry(const GeoArea& area);  // always a multipolygon
GeometryHandle line_geometry(const std::vector<LonLat>& points);

// Polygons and what is made of them; parts without an area are left out.
GeoArea area_from(const OGRGeometry& geometry);

// The union. Throws Error when GEOS cannot make it.
GeometryHandle unite(const GeoArea& polygons);

}  // namespace nadir
