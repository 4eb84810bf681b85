#include "package/tile_need.hpp"

#include <cmath>

#include "geodesy/web_mercator.hpp"

namespace nadir {
namespace {

double distance_m(PlanePoint a, PlanePoint b) { return std::hypot(a.east_m - b.east_m, a.north_m - b.north_m); }

}  // namespace

TileFootprint::TileFootprint(const LocalFrame& frame, const TileKey& key) {
  const LonLatBox box = bounds_of(key);
  const std::array<LonLat, 4> corners{LonLat{box.west_deg, box.north_deg}, LonLat{box.east_deg, box.north_deg},
                                      LonLat{box.west_deg, box.south_deg}, LonLat{box.east_deg, box.south_deg}};
  for (std::size_t i = 0; i < corners.size(); ++i) {
    const Enu enu = frame.enu_from_lonlat(corners[i]);
    corners_[i] = {enu.east_m, enu.north_m};
  }
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

TileNeed::TileNeed(Region region) : region_(std::move(region)) {
  for (const PlaneRing& ring : region_.rings) {
    outlines_.push_back(ring);
    outlines_.back().push_back(ring.front());
  }
}

TileNeed::Place TileNeed::classify(PlanePoint centre, double radius_m) const {
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

bool TileNeed::visit_needed(const TileFootprint& tile, const Block& block,
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

bool TileNeed::needs(const TileFootprint& tile) const {
  return !visit_needed(tile, {0, 0, kTileSize}, [](const Block&) { return false; });
}

Bytes TileNeed::missing_mask(const TileFootprint& tile, std::span<const std::uint8_t> mask) const {
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

std::uint64_t TileNeed::missing_pixels(const TileFootprint& tile, std::span<const std::uint8_t> mask) const {
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

}  // namespace nadir
