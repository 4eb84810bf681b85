// Does a tile set hold what the mission needs? The builder asks before it puts a package into place, verification asks
// about signed packages, `nadir cache validate` about anybody's MBTiles. Same rules for all.
//
// Coverage is judged by area: every pixel centre of the mission's region, at the finest zoom, must lie on a valid pixel
// of a tile that is there. A tile is needed at zoom z exactly when one of its pixel centres lies in the region.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "base/error.hpp"
#include "base/time.hpp"
#include "package/mission.hpp"
#include "package/sidecar.hpp"

namespace nadir {

// Tiles of one zoom that the mission needs, in the order of TileKey.
std::vector<TileKey> required_tiles(const Mission& mission, int zoom);

// "coverage.gap", one finding per zoom with holes and one per hole up to a limit. Tiles sorted by key.
Findings judge_coverage(const Mission& mission, std::span<const Sidecar> tiles);

// "freshness.stale": tiles that the region touches and that are older at `at` than their sector allows. Where sectors
// overlap, the strictest decides; the corridor outside of every sector counts as active.
Findings judge_freshness(const Mission& mission, std::span<const Sidecar> tiles, UtcTime at);

// "resolution.coarse": tiles of the finest zoom made from imagery coarser than min_resolution_m.
Findings judge_resolution(const Mission& mission, std::span<const Sidecar> tiles);

// "budget.exceeded": budget_mb is in units of 10^6 bytes, for the whole package.
Findings judge_budget(const Mission& mission, std::uint64_t package_bytes);

// All four.
Findings judge_tiles(const Mission& mission, std::span<const Sidecar> tiles, std::uint64_t package_bytes, UtcTime at);

// The sector that decides about this tile, null outside of all.
const Sector* deciding_sector(const Mission& mission, const LocalFrame& frame, const TileKey& key);

}  // namespace nadir
