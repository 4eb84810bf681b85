// Which tiles a build or an update makes, known before a pixel is read: where the imagery lies, around what the mission
// requires.
//
// Work is split into metatiles: square blocks of tiles, aligned to a coarser zoom, which are warped at once.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "package/mission.hpp"
#include "raster/imagery_input.hpp"

namespace nadir {

inline constexpr int kTilePixels = kTileSize * kTileSize;

// A rectangle of tiles of one zoom; the last column and row are included. Empty when last < first.
struct TileRange {
  int zoom = 0;
  std::int64_t first_x = 0, first_y = 0, last_x = -1, last_y = -1;

  bool empty() const { return last_x < first_x || last_y < first_y; }
  bool contains(const TileKey& key) const {
    return key.z == zoom && key.x >= first_x && key.x <= last_x && key.y >= first_y && key.y <= last_y;
  }
  TileRange at_zoom(int coarser) const;
};

// At the mission's finest zoom: tiles that both the imagery and the mission's bounds plus a margin touch. The margin
// lets an aircraft at the edge of its corridor match what lies beyond.
inline constexpr double kMargin_m = 250.0;
TileRange wanted_range(const Mission& mission);  // if imagery covered everything
TileRange plan_range(const Mission& mission, std::span<const ImageryInput> inputs);

// "coverage.elsewhere": no raster lies near the mission. One finding, which says how far away it lies, and whether it
// would fit with longitude and latitude exchanged.
Findings check_place(const Mission& mission, std::span<const ImageryInput> inputs);

// The sidecars of the tiles that the mission requires, as they would be if every pixel inside the outlines were valid.
// Errors that they show are reported before any work. Digests are missing.
std::vector<Sidecar> plan_sidecars(const Mission& mission, std::span<const ImageryInput> inputs,
                                   const TileRange& range);

// Metatiles of the range that come within kMargin_m of the sectors or of the corridor: most of the box around a long
// route is not needed. In Morton order: neighbours in the plane stay close in the sequence.
std::vector<TileKey> metatiles_of(const Mission& mission, const TileRange& range);

struct ZoomCount {
  int zoom = 0;
  std::uint64_t tiles = 0;

  bool operator==(const ZoomCount&) const = default;
};

// The number of tiles of the metatiles and of the overviews above them, from min_zoom to the finest, if imagery covers
// everything.
std::vector<ZoomCount> count_tiles(std::span<const TileKey> metatiles, const TileRange& range, int min_zoom);

// The number of tiles of a build of this mission if imagery covers everything.
std::vector<ZoomCount> count_whole_build(const Mission& mission);

}  // namespace nadir
