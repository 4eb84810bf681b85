// Areas on the ground in longitude and latitude, and GDAL's geometries of them. GEOS does the set operations.
//
// The shape is GeoJSON's: polygons of rings, the first ring the outline, the others its holes, each ring closed by its
// first point.
#pragma once

#include <memory>
#include <span>
#include <vector>

#include "geodesy/lon_lat.hpp"
#include "package/coverage_gaps.hpp"
#include "package/mission.hpp"
#include "package/sidecar.hpp"

class OGRGeometry;

namespace nadir {

using GeoRing = std::vector<LonLat>;
using GeoPolygon = std::vector<GeoRing>;
using GeoArea = std::vector<GeoPolygon>;  // disjoint; none inside another

struct DeleteGeometry {
  void operator()(OGRGeometry* geometry) const;
};
using GeometryHandle = std::unique_ptr<OGRGeometry, DeleteGeometry>;

GeometryHandle polygon_geometry(const GeoPolygon& polygon);
GeometryHandle area_geometry(const GeoArea& area);  // always a multipolygon
GeometryHandle line_geometry(const std::vector<LonLat>& points);

// Polygons and collections of them; parts without an area are dropped.
GeoArea area_from(const OGRGeometry& geometry);

// Throws Error when GEOS fails.
GeometryHandle union_of(const GeoArea& polygons);

// The ground within the half width of the route, buffered in the mission's local frame.
GeoPolygon corridor_area(const Mission& mission);                      // of a mission with a route
GeoPolygon sector_area(const Mission& mission, const Sector& sector);  // with its buffer

// Sectors and corridor together.
GeoArea mission_area(const Mission& mission);

// The valid pixels of these tiles, which are all of one zoom and in the order of TileKey; along the edges of pixels.
GeoArea footprint_of(std::span<const Sidecar* const> tiles);

GeoPolygon area_of(const TileKey& key);
GeoArea area_of(const TileKey& key, std::span<const PixelPolygon> outlines);  // pixels of the tile

}  // namespace nadir
