// The data of the report's map: tiles with their state, sectors, route and gaps, in pixels of the mission's finest zoom
// relative to `origin` (x east, y south).
#pragma once

#include <nlohmann/json_fwd.hpp>

#include "commands/cache/report/cache_report.hpp"

namespace nadir {

// {cells, cell_size, zoom, metres_per_pixel, sectors, route, half_width, gaps, summary, matchability where it was asked
// for}. A set with very many tiles is shown at a coarser zoom, each cell as bad as the worst tile in it.
nlohmann::json coverage_map(const CacheReport& report);

}  // namespace nadir
