#include "package/gaps.hpp"

#include <algorithm>

#include "geodesy/web_mercator.hpp"
#include "package/judge.hpp"
#include "package/tile_mask.hpp"
#include "package/tile_need.hpp"

namespace nadir {
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
