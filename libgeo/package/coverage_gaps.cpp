// Outlines of a mask: the edges between pixels inside and outside, chained to rings.
//
// Every edge is directed so that the inside lies to its left on the map (rows grow to the south). Where two inside
// pixels touch at a corner alone, four edges meet; the chain turns left there, around the pixel that it follows. So an
// outer ring never touches itself; a hole that does is cut into several at the shared corner.
#include "package/coverage_gaps.hpp"

#include <algorithm>
#include <cstdint>
#include <cstdlib>

#include "geodesy/web_mercator.hpp"
#include "package/coverage_requirement.hpp"
#include "package/tile_image.hpp"

namespace nadir {
namespace {

enum Direction : std::uint8_t { east, north, west, south };  // turning left adds one
constexpr std::array<PixelCorner, 4> kSteps{{{1, 0}, {0, -1}, {-1, 0}, {0, 1}}};
constexpr int kCorners = kTileSize + 1;

class OutlineTracer {
 public:
  explicit OutlineTracer(ByteView mask) : mask_(mask), edges_(kCount), position_(kCount, -1) {
    for (int row = 0; row < kTileSize; ++row) {
      for (int column = 0; column < kTileSize; ++column) {
        if (!inside(column, row)) continue;
        if (!inside(column, row + 1)) edges({column, row + 1}) |= bit(east);
        if (!inside(column + 1, row)) edges({column + 1, row + 1}) |= bit(north);
        if (!inside(column, row - 1)) edges({column + 1, row}) |= bit(west);
        if (!inside(column - 1, row)) edges({column, row}) |= bit(south);
      }
    }
  }

  // Walks start at the topmost, then leftmost corner that is left. No two rings share that one, so a walk that comes
  // back to it is complete.
  std::vector<PixelRing> rings() {
    for (int row = 0; row < kCorners; ++row) {
      for (int column = 0; column < kCorners; ++column) {
        while (edges({column, row}) != 0) walk({column, row});
      }
    }
    return std::move(rings_);
  }

 private:
  static constexpr std::size_t kCount = static_cast<std::size_t>(kCorners) * kCorners;

  static std::uint8_t bit(int direction) { return static_cast<std::uint8_t>(1U << static_cast<unsigned>(direction)); }
  static std::size_t index(PixelCorner corner) {
    return static_cast<std::size_t>(corner.row * kCorners + corner.column);
  }
  std::uint8_t& edges(PixelCorner corner) { return edges_[index(corner)]; }
  bool inside(int column, int row) const {
    return column >= 0 && row >= 0 && column < kTileSize && row < kTileSize &&
           mask_[static_cast<std::size_t>(row * kTileSize + column)] != 0;
  }
  int next_direction(PixelCorner corner, int heading) {
    for (const int turn : {1, 0, 3}) {
      const int direction = (heading + turn) % 4;
      if ((edges(corner) & bit(direction)) != 0) return direction;
    }
    return heading;
  }

  void walk(PixelCorner start) {
    PixelRing ring;
    PixelCorner corner = start;
    int heading = east;
    while ((edges(start) & bit(heading)) == 0) ++heading;
    int last = -1;
    do {
      if (heading != last) append(ring, corner);
      last = heading;
      edges(corner) = static_cast<std::uint8_t>(edges(corner) & ~bit(heading));
      const PixelCorner step = kSteps[static_cast<std::size_t>(heading)];
      corner = {corner.column + step.column, corner.row + step.row};
      heading = next_direction(corner, heading);
    } while (!(corner == start));
    finish(ring, 0);
  }

  // A corner that the ring has already passed closes a separate ring.
  void append(PixelRing& ring, PixelCorner corner) {
    if (const int before = position_[index(corner)]; before >= 0) finish(ring, static_cast<std::size_t>(before));
    position_[index(corner)] = static_cast<int>(ring.size());
    ring.push_back(corner);
  }

  // Takes the corners from `first` on out of `ring`.
  void finish(PixelRing& ring, std::size_t first) {
    const auto begin = ring.begin() + static_cast<std::ptrdiff_t>(first);
    PixelRing closed(begin, ring.end());
    for (const PixelCorner& corner : closed) position_[index(corner)] = -1;
    closed.push_back(closed.front());
    rings_.push_back(std::move(closed));
    ring.erase(begin, ring.end());
  }

  ByteView mask_;
  std::vector<std::uint8_t> edges_;  // per corner, which directed edges begin there
  std::vector<int> position_;        // of the corner in the ring that is being walked, -1: not in it
  std::vector<PixelRing> rings_;
};

// Twice the area, positive when counter-clockwise on the map.
long area2(const PixelRing& ring) {
  long sum = 0;
  for (std::size_t i = 1; i < ring.size(); ++i) {
    sum += static_cast<long>(ring[i].column) * ring[i - 1].row - static_cast<long>(ring[i - 1].column) * ring[i].row;
  }
  return sum;
}

// Of the pixel's centre, by the edges to the west of it.
bool contains(const PixelRing& ring, PixelCorner pixel) {
  bool inside = false;
  for (std::size_t i = 1; i < ring.size(); ++i) {
    const PixelCorner &a = ring[i - 1], &b = ring[i];
    if (a.column != b.column || a.column > pixel.column) continue;
    if (std::min(a.row, b.row) <= pixel.row && pixel.row < std::max(a.row, b.row)) inside = !inside;
  }
  return inside;
}

// The inside pixel along the ring's first edge.
PixelCorner pixel_beside(const PixelRing& ring) {
  const PixelCorner &a = ring[0], &b = ring[1];
  if (a.row == b.row) return b.column > a.column ? PixelCorner{a.column, a.row - 1} : PixelCorner{b.column, a.row};
  return b.row > a.row ? PixelCorner{a.column, a.row} : PixelCorner{a.column - 1, b.row};
}

}  // namespace

std::vector<PixelPolygon> outlines_of(ByteView mask) {
  std::vector<PixelPolygon> polygons;
  std::vector<PixelRing> holes;
  for (PixelRing& ring : OutlineTracer(mask).rings()) {
    if (area2(ring) > 0) {
      polygons.push_back({std::move(ring), {}});
    } else {
      holes.push_back(std::move(ring));
    }
  }
  for (PixelRing& hole : holes) {
    PixelPolygon* owner = nullptr;  // the smallest around it
    for (PixelPolygon& polygon : polygons) {
      if (!contains(polygon.outer, pixel_beside(hole))) continue;
      if (owner == nullptr || area2(polygon.outer) < area2(owner->outer)) owner = &polygon;
    }
    if (owner != nullptr) owner->holes.push_back(std::move(hole));
  }
  return polygons;
}

namespace {

const Sidecar* find(std::span<const Sidecar> tiles, const TileKey& key) {
  const auto found = std::lower_bound(tiles.begin(), tiles.end(), key,
                                      [](const Sidecar& tile, const TileKey& wanted) { return tile.key < wanted; });
  return found != tiles.end() && found->key == key ? &*found : nullptr;
}

std::optional<Bytes> valid_pixels(const Sidecar* tile) {
  return tile == nullptr ? std::nullopt : decode_tile_mask(tile->mask);
}

}  // namespace

std::vector<Gap> find_gaps(const Mission& mission, std::span<const Sidecar> tiles, int zoom) {
  const LocalFrame frame = mission_frame(mission);
  const CoverageRequirement need(required_region(mission, frame));
  std::vector<Gap> gaps;
  for (const TileKey& key : required_tiles(mission, zoom)) {
    const Sidecar* tile = find(tiles, key);
    if (tile != nullptr && (tile->valid_ppm == kWholeTile_ppm || zoom < mission.zoom.max)) continue;
    const TileFootprint footprint(frame, key);
    const std::optional<Bytes> mask = valid_pixels(tile);
    const std::uint64_t pixels = need.missing_pixels(footprint, mask ? ByteView(*mask) : ByteView());
    if (pixels == 0) continue;
    gaps.push_back({key, pixels, static_cast<double>(pixels) * footprint.pixel_area_m2(), tile == nullptr});
  }
  return gaps;
}

std::vector<PixelPolygon> outlines_of(const Gap& gap, const Mission& mission, std::span<const Sidecar> tiles) {
  const LocalFrame frame = mission_frame(mission);
  const CoverageRequirement need(required_region(mission, frame));
  const std::optional<Bytes> valid = valid_pixels(find(tiles, gap.key));
  return outlines_of(need.missing_mask(TileFootprint(frame, gap.key), valid ? ByteView(*valid) : ByteView()));
}

LonLat place_of(const TileKey& key, PixelCorner corner) {
  return lonlat_from_pixel(
      {static_cast<double>(key.x) * kTileSize + corner.column, static_cast<double>(key.y) * kTileSize + corner.row},
      key.z);
}

}  // namespace nadir
