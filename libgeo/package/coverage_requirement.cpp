#include "package/coverage_requirement.hpp"

#include <algorithm>
#include <cmath>

#include "geodesy/web_mercator.hpp"

namespace nadir {
namespace {}  // namespace

TileFootprint::TileFootprint(const LocalFrame& frame, const TileKey& key) {
  const LonLatBox box = bounds_of(key);
  const std::array<LonLat, 4> corners{LonLat{box.west_deg, box.north_deg}, LonLat{box.east_deg, box.north_deg},
                                      LonLat{box.west_deg, box.south_deg}, LonLat{box.east_deg, box.south_deg}};
  for (std::size_t i = 0; i < corners.size(); ++i) corners_[i] = frame.plane_from_lonlat(corners[i]);
}

PlanePoint TileFootprint::place(double column, double row) const {
  const double u = column / kTileSize, v = row / kTileSize;
  const auto blend = [u, v](double nw, double ne, double sw, double se) {
    return (1 - v) * ((1 - u) * nw + u * ne) + v * ((1 - u) * sw + u * se);
  };
  return {blend(corners_[0].east_m, corners_[1].east_m, corners_[2].east_m, corners_[3].east_m),
          blend(corners_[0].north_m, corners_[1].north_m, corners_[2].north_m, corners_[3].north_m)};
}

double TileFootprint::pixel_area_m2() const {
  const PlaneRing ring{corners_[0], corners_[1], corners_[3], corners_[2]};
  return std::abs(area_m2(ring)) / (static_cast<double>(kTileSize) * kTileSize);
}

CoverageRequirement::CoverageRequirement(Region region) : region_(std::move(region)) {
  for (const PlaneRing& ring : region_.rings) {
    outlines_.push_back(ring);
    outlines_.back().push_back(ring.front());
  }
}

CoverageRequirement::Place CoverageRequirement::classify(PlanePoint centre, double radius_m) const {
  bool mixed = false;
  for (std::size_t i = 0; i < outlines_.size(); ++i) {
    if (distance_to_path_m(outlines_[i], centre) <= radius_m) {
      mixed = true;
    } else if (contains(region_.rings[i], centre)) {
      return Place::inside;
    }
  }
  for (const Corridor& corridor : region_.corridors) {
    const double away_m = distance_to_path_m(corridor.path, centre);
    if (away_m + radius_m <= corridor.half_width_m) return Place::inside;
    if (away_m - radius_m <= corridor.half_width_m) mixed = true;
  }
  return mixed ? Place::mixed : Place::outside;
}

bool CoverageRequirement::visit_needed(const TileFootprint& tile, const Block& block,
                                       const std::function<bool(const Block&)>& visit) const {
  const PlanePoint centre = tile.place(block.column + block.size / 2.0, block.row + block.size / 2.0);
  if (block.size == 1) return !region_.contains(centre) || visit(block);
  // Longitude and latitude lines are not quite square in the plane: a little more than the half diagonal.
  const double radius_m = 1.01 * distance_m(centre, tile.place(block.column, block.row));
  switch (classify(centre, radius_m)) {
    case Place::outside: return true;
    case Place::inside: return visit(block);
    case Place::mixed: break;
  }
  const int half = block.size / 2;
  return visit_needed(tile, {block.column, block.row, half}, visit) &&
         visit_needed(tile, {block.column + half, block.row, half}, visit) &&
         visit_needed(tile, {block.column, block.row + half, half}, visit) &&
         visit_needed(tile, {block.column + half, block.row + half, half}, visit);
}

bool CoverageRequirement::needs(const TileFootprint& tile) const {
  return !visit_needed(tile, {0, 0, kTileSize}, [](const Block&) { return false; });
}

Bytes CoverageRequirement::missing_mask(const TileFootprint& tile, std::span<const std::uint8_t> mask) const {
  Bytes missing(static_cast<std::size_t>(kTileSize) * kTileSize, 0);
  visit_needed(tile, {0, 0, kTileSize}, [&](const Block& block) {
    for (int row = block.row; row < block.row + block.size; ++row) {
      for (int column = block.column; column < block.column + block.size; ++column) {
        const auto pixel = static_cast<std::size_t>(row * kTileSize + column);
        if (mask.empty() || mask[pixel] == 0) missing[pixel] = 255;
      }
    }
    return true;
  });
  return missing;
}

std::uint64_t CoverageRequirement::missing_pixels(const TileFootprint& tile, std::span<const std::uint8_t> mask) const {
  std::uint64_t missing = 0;
  visit_needed(tile, {0, 0, kTileSize}, [&](const Block& block) {
    if (mask.empty()) {
      missing += static_cast<std::uint64_t>(block.size) * static_cast<std::uint64_t>(block.size);
      return true;
    }
    for (int row = block.row; row < block.row + block.size; ++row) {
      for (int column = block.column; column < block.column + block.size; ++column) {
        missing += mask[static_cast<std::size_t>(row * kTileSize + column)] == 0 ? 1U : 0U;
      }
    }
    return true;
  });
  return missing;
}

namespace {

// Where nothing is pruned yet: tiles of some 150 km, of which a mission touches few.
constexpr int kFirstZoom = 8;

struct Disc {
  PlanePoint centre;
  double radius_m = 0;
};

// Around the whole tile. Its sides are curves in the plane: a tenth more than its corners need.
Disc disc_around(const LocalFrame& frame, const TileKey& key) {
  const LonLatBox box = bounds_of(key);
  const auto place = [&](double lon_deg, double lat_deg) { return frame.plane_from_lonlat({lon_deg, lat_deg}); };
  Disc disc{place((box.west_deg + box.east_deg) / 2, (box.south_deg + box.north_deg) / 2)};
  for (const double lon_deg : {box.west_deg, box.east_deg}) {
    for (const double lat_deg : {box.south_deg, box.north_deg}) {
      disc.radius_m = std::max(disc.radius_m, 1.1 * distance_m(disc.centre, place(lon_deg, lat_deg)));
    }
  }
  return disc;
}

void add_all_below(const TileKey& key, int zoom, std::vector<TileKey>& keys) {
  const int steps = zoom - key.z;
  const std::uint32_t across = std::uint32_t{1} << steps;
  for (std::uint32_t x = key.x << steps, column = 0; column < across; ++x, ++column) {
    for (std::uint32_t y = key.y << steps, row = 0; row < across; ++y, ++row) {
      keys.push_back({static_cast<std::uint8_t>(zoom), x, y});
    }
  }
}

void descend(const CoverageRequirement& need, const LocalFrame& frame, const TileKey& key, int zoom,
             std::vector<TileKey>& keys) {
  if (key.z == zoom) {
    if (need.needs(TileFootprint(frame, key))) keys.push_back(key);
    return;
  }
  const Disc disc = disc_around(frame, key);
  if (!need.may_meet(disc.centre, disc.radius_m)) return;
  if (need.holds(disc.centre, disc.radius_m)) return add_all_below(key, zoom, keys);
  for (const std::uint32_t x : {2 * key.x, 2 * key.x + 1}) {
    for (const std::uint32_t y : {2 * key.y, 2 * key.y + 1}) {
      descend(need, frame, {static_cast<std::uint8_t>(key.z + 1), x, y}, zoom, keys);
    }
  }
}

}  // namespace

std::vector<TileKey> tiles_of_region(const CoverageRequirement& need, const LocalFrame& frame, int zoom) {
  const PlaneBox box = need.region().bounds();
  const auto first = static_cast<std::uint8_t>(std::min(zoom, kFirstZoom));
  TileKey low{first, UINT32_MAX, UINT32_MAX}, high{first, 0, 0};
  for (const double east_m : {box.west_m, (box.west_m + box.east_m) / 2, box.east_m}) {
    for (const double north_m : {box.south_m, (box.south_m + box.north_m) / 2, box.north_m}) {
      const TileKey key = tile_at(frame.lonlat_from_plane({east_m, north_m}), first);
      low.x = std::min(low.x, key.x), low.y = std::min(low.y, key.y);
      high.x = std::max(high.x, key.x), high.y = std::max(high.y, key.y);
    }
  }
  std::vector<TileKey> keys;
  for (std::uint32_t x = low.x; x <= high.x; ++x) {
    for (std::uint32_t y = low.y; y <= high.y; ++y) descend(need, frame, {first, x, y}, zoom, keys);
  }
  std::sort(keys.begin(), keys.end());
  return keys;
}

std::vector<TileKey> required_tiles(const Mission& mission, int zoom) {
  const LocalFrame frame = mission_frame(mission);
  return tiles_of_region(CoverageRequirement(required_region(mission, frame)), frame, zoom);
}

}  // namespace nadir
