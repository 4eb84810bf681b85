// Which tiles a build makes, known before a pixel is read: where the imagery lies, around what the mission requires.
#pragma once

#include <span>
#include <vector>

#include "raster/imagery_input.hpp"
#include "package/mission.hpp"

namespace nadir {

inline constexpr int kTilePixels = kTileSize * kTileSize;

// Tiles of one zoom; last column and row are inside. Empty when last < first.
struct TileRange {
  int zoom = 0;
  std::int64_t first_x = 0, first_y = 0, last_x = -1, last_y = -1;

  bool empty() const { return last_x < first_x || last_y < first_y; }
  std::int64_t count() const { return empty() ? 0 : (last_x - first_x + 1) * (last_y - first_y + 1); }
  bool contains(const TileKey& key) const {
    return key.z == zoom && key.x >= first_x && key.x <= last_x && key.y >= first_y && key.y <= last_y;
  }
  TileRange at_zoom(int coarser) const;
};

// At the mission's finest zoom: tiles that both the imagery and the mission's bounds, widened by a margin, touch. The
// margin lets an aircraft at the rim of its corridor match with what lies beyond.
inline constexpr double kMargin_m = 250.0;
TileRange wanted_range(const Mission& mission);  // with imagery everywhere
TileRange plan_range(const Mission& mission, std::span<const ImageryInput> inputs);

// The sidecars of the tiles that the mission requires, as they would be if every pixel inside the outlines were valid:
// what can be refused, can be refused before the work. Digests are missing.
std::vector<Sidecar> plan_sidecars(const Mission& mission, std::span<const ImageryInput> inputs,
                                   const TileRange& range);

}  // namespace nadir
