// Where a tile set lacks what the mission needs, tile by tile, and the outlines of what is missing.
//
// A gap at the finest zoom is the set of pixels whose centres the mission's region needs and that are not valid. At the
// coarser zooms, which are never matched with alone, only a tile that is absent is a gap.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "base/bytes.hpp"
#include "geodesy/lon_lat.hpp"
#include "package/mission.hpp"
#include "package/sidecar.hpp"

namespace nadir {

struct Gap {
  TileKey key;
  std::uint64_t pixels = 0;  // needed and not valid
  double area_m2 = 0;
  bool whole_tile = false;  // the tile is absent
};

// Gaps of one zoom in the order of TileKey. tiles: sorted by key.
std::vector<Gap> find_gaps(const Mission& mission, std::span<const Sidecar> tiles, int zoom);

// Corners of pixels: (0, 0) is the north-west corner of the tile, (256, 256) the south-east one.
struct PixelCorner {
  int column = 0;
  int row = 0;

  bool operator==(const PixelCorner&) const = default;
};
using PixelRing = std::vector<PixelCorner>;  // closed: the last corner repeats the first

// Rings as GeoJSON orders them: on the map with north up the outer ring is counter-clockwise, holes are clockwise.
struct PixelPolygon {
  PixelRing outer;
  std::vector<PixelRing> holes;
};

// The outlines of the pixels that are not 0 in `mask` (kTileSize² bytes in rows), along the pixels' edges. Pixels that
// touch at a corner alone belong to different polygons, so that no ring touches itself.
std::vector<PixelPolygon> outlines_of(ByteView mask);

// The outlines of the gap.
std::vector<PixelPolygon> outlines_of(const Gap& gap, const Mission& mission, std::span<const Sidecar> tiles);

LonLat place_of(const TileKey& key, PixelCorner corner);

}  // namespace nadir
