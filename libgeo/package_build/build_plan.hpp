// Which metatiles a build or an update makes, and how many tiles they come to.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "package_build/tile_plan.hpp"

namespace nadir {

// Metatiles of the range that come within kMargin_m of the sectors or of the corridor: the box around a long route is
// mostly nobody's need. In the order of a space-filling curve: what is near in the plane stays near in the sequence.
std::vector<TileKey> metatiles_of(const Mission& mission, const TileRange& range);

struct ZoomCount {
  int zoom = 0;
  std::uint64_t tiles = 0;

  bool operator==(const ZoomCount&) const = default;
};

// The tiles of the metatiles and of the overviews above them, from min_zoom to the finest, if imagery covers all.
std::vector<ZoomCount> count_tiles(std::span<const TileKey> metatiles, const TileRange& range, int min_zoom);

// What a build makes of this mission where imagery covers everything.
std::vector<ZoomCount> count_whole_build(const Mission& mission);

}  // namespace nadir
