// Which tiles, and which of their pixels, the mission's region needs: those whose centres lie in it.
//
// Most tiles lie entirely inside or outside; only along the boundary are blocks of pixels split, down to single ones. A
// block is classified by its circumscribed circle and the region's distance functions.
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <span>
#include <vector>

#include "base/bytes.hpp"
#include "geodesy/region.hpp"
#include "geodesy/web_mercator.hpp"
#include "package/mission.hpp"

namespace nadir {

// A tile as a quadrilateral in the local plane. Tiles are small (1.2 km at zoom 15): pixels are interpolated between
// the corners, which is wrong by centimetres there and by less than a millimetre at the zooms that are flown with.
class TileFootprint {
 public:
  TileFootprint(const LocalFrame& frame, const TileKey& key);

  // Continuous pixel coordinates, (0, 0) the north-west corner; a pixel's centre is at +0.5.
  PlanePoint place(double column, double row) const;
  double pixel_area_m2() const;

 private:
  std::array<PlanePoint, 4> corners_;  // north-west, north-east, south-west, south-east
};

class CoverageRequirement {
 public:
  explicit CoverageRequirement(Region region);

  // Whether one of the tile's pixel centres lies in the region.
  bool needs(const TileFootprint& tile) const;
  // How many needed pixels are not valid. mask: kTileSize² bytes in rows, not 0 where valid; empty: none is valid.
  std::uint64_t missing_pixels(const TileFootprint& tile, std::span<const std::uint8_t> mask) const;

  // The same pixels one by one: kTileSize² bytes in rows, 255 where a pixel is needed and not valid.
  Bytes missing_mask(const TileFootprint& tile, std::span<const std::uint8_t> mask) const;

  // Whether a disc reaches into the region; may be true where it only nearly does.
  bool may_meet(PlanePoint centre, double radius_m) const { return classify(centre, radius_m) != Place::outside; }

  // Whether a disc lies entirely in one part of the region.
  bool holds(PlanePoint centre, double radius_m) const { return classify(centre, radius_m) == Place::inside; }

  const Region& region() const { return region_; }

 private:
  enum class Place { outside, inside, mixed };
  struct Block {
    int column, row, size;
  };
  Place classify(PlanePoint centre, double radius_m) const;
  // Calls `visit` with blocks that are needed entirely; stops when it returns false. False when stopped.
  bool visit_needed(const TileFootprint& tile, const Block& block,
                    const std::function<bool(const Block&)>& visit) const;

  Region region_;
  std::vector<PlanePath> outlines_;  // the rings, closed
};

// The tiles of a zoom with a pixel that is needed, in the order of TileKey. From coarse tiles down, so that it takes as
// long as the region is large, not as its bounding box.
std::vector<TileKey> tiles_of_region(const CoverageRequirement& need, const LocalFrame& frame, int zoom);

// Tiles of one zoom that the mission needs, in the order of TileKey.
std::vector<TileKey> required_tiles(const Mission& mission, int zoom);

}  // namespace nadir
