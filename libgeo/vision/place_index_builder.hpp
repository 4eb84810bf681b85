// Builds the place index of a map: lays chunks over it, describes each, trains the projection on them.
#pragma once

#include <vector>

#include "base/digest.hpp"
#include "base/progress.hpp"
#include "vision/place_index.hpp"

namespace nadir {

struct PlaceIndexOptions {
  std::vector<double> footprints_m;         // sides of the chunks, one layer each
  std::optional<double> gsd_m;              // of the patches; by default 96 pixels a side, not finer than the map
  int overlap_percent = 75;                 // of neighbouring chunks, along a side
  std::vector<std::int64_t> sides_px = {};  // of the patches, one for each footprint, instead of gsd_m
  int threads = 1;                          // the result does not depend on it
};

// The map that is indexed.
struct IndexedMap {
  const TileSource* tiles = nullptr;
  std::vector<TileKey> keys;  // of the finest zoom
  Sha256 merkle_root;
  LonLat origin;  // of the mission's plane
};

// The same map and options give the same bytes. Throws UsageError when no chunk is left or there would be too many.
PlaceIndex build_place_index(const IndexedMap& map, const PlaceIndexOptions& options, Progress& progress);

// Side of the square that has the footprint's area.
double place_footprint_m(double width_m, double height_m);

}  // namespace nadir
