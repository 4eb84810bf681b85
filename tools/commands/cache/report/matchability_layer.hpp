// The matchability map as a layer of the report's map, in its pixels.
#pragma once

#include <nlohmann/json_fwd.hpp>

#include "geodesy/web_mercator.hpp"
#include "commands/cache/matchability_request.hpp"
#include "package/mission.hpp"

namespace nadir {

// {cell_size, cells, stretches, and what json_of() says}. cells: [x, y, class, ratio, score, entropy, texture, valid].
// Very many places are shown in blocks, each as the worst place in it.
nlohmann::json matchability_layer(const MatchabilityResult& result, const Mission& mission, GlobalPixel origin);

}  // namespace nadir
