// The shapes that the catalogue draws: what a mission is for, its corridor, and where a source's pixels lie.
#pragma once

#include <span>

#include "catalogue/catalogue_area.hpp"
#include "package/mission.hpp"
#include "package/sidecar.hpp"

namespace nadir {

// The ground within the half width of the route, buffered in the mission's local metres.
GeoPolygon corridor_area(const Mission& mission);

// Sectors and corridor together.
GeoArea mission_area(const Mission& mission);

// The valid pixels of these tiles, which are all of one zoom and in the order of TileKey; along the edges of pixels.
GeoArea footprint_of(std::span<const Sidecar* const> tiles);

GeoPolygon area_of(const TileKey& key);

}  // namespace nadir
