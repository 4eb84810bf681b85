// A landscape as a map of OpenStreetMap would have it: roads, water, woods and buildings, with its tags.
#pragma once

#include <functional>
#include <string>

#include "geodesy/lon_lat.hpp"
#include "simulation/landscape.hpp"

namespace nadir {

// GeoJSON (RFC 7946) of what stands on both days: highway=secondary|residential|unclassified|track, waterway=river and
// natural=water, natural=wood, building=yes. The same landscape gives the same bytes.
std::string world_vectors(const Landscape& land, const std::function<LonLat(GroundPoint)>& lonlat);

}  // namespace nadir
