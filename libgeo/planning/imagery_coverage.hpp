// Where imagery would leave gaps in a mission's map, before anything is built.
//
// The tiles that the mission requires are looked at in the imagery's own map tiles, at a zoom that is coarse enough for
// an answer while somebody draws. What `nadir cache build` finds at the finest zoom differs from it by a pixel of this
// zoom at edges. The rules are those of package/mission_check.hpp: imagery counts where it is not coarser than
// min_resolution_m and not older than the freshness days of the tile's sector.
#pragma once

#include <cstddef>
#include <nlohmann/json_fwd.hpp>
#include <span>

#include "base/time.hpp"
#include "package/mission.hpp"
#include "planning/map_sources.hpp"

namespace nadir {

// RFC 7946: one feature per tile and reason, "no imagery" or "imagery too old or too coarse", with tile, area_m2 and
// sector; and beside the features zoom, needed_m2 and missing_m2. most: tiles that are looked at. Sources with a
// problem are left out.
nlohmann::json imagery_coverage_geojson(const Mission& mission, const MapSources& sources, UtcTime at,
                                        std::size_t most);

}  // namespace nadir
