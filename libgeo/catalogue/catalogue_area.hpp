// Areas on the ground as longitudes and latitudes, in GeoJSON's shape: polygons of rings, the first ring the outline,
// the others its holes, each ring closed by its first point.
#pragma once

#include <vector>

#include "geodesy/lon_lat.hpp"

namespace nadir {

using GeoRing = std::vector<LonLat>;
using GeoPolygon = std::vector<GeoRing>;
using GeoArea = std::vector<GeoPolygon>;  // may lie apart; none inside another

}  // namespace nadir
