// Gaps as GeoJSON (RFC 7946): WGS84 longitude first, outer rings counter-clockwise, one feature per tile.
#pragma once

#include <nlohmann/json_fwd.hpp>
#include <span>
#include <vector>

#include "package/coverage_gaps.hpp"

namespace nadir {

nlohmann::json gaps_geojson(const std::vector<Gap>& gaps, const Mission& mission, std::span<const Sidecar> tiles);

}  // namespace nadir
