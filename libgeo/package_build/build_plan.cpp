#include "package_build/build_plan.hpp"

#include <algorithm>
#include <set>

#include "package/coverage_requirement.hpp"

namespace nadir {
namespace {

constexpr int kMetatileSteps = 3;  // 8 x 8 tiles: 2048 pixels a side, 16 MiB

std::uint64_t along_curve(const TileKey& key) {  // Morton order
  std::uint64_t code = 0;
  for (unsigned bit = 0; bit < kMaxZoom; ++bit) {
    code |= (std::uint64_t{(key.x >> bit) & 1U} << (2 * bit)) | (std::uint64_t{(key.y >> bit) & 1U} << (2 * bit + 1));
  }
  return code;
}

// Everything within margin_m of the region.
Region widened(Region region, double margin_m) {
  for (Corridor& corridor : region.corridors) corridor.half_width_m += margin_m;
  for (const PlaneRing& ring : region.rings) {
    Corridor rim{ring, margin_m};
    rim.path.push_back(ring.front());
    region.corridors.push_back(std::move(rim));
  }
  return region;
}

}  // namespace

std::vector<TileKey> metatiles_of(const Mission& mission, const TileRange& range) {
  const TileRange tops = range.at_zoom(std::max(mission.zoom.min, range.zoom - kMetatileSteps));
  const LocalFrame frame = mission_frame(mission);
  const CoverageRequirement near_by(widened(required_region(mission, frame), kMargin_m));
  std::vector<TileKey> keys = tiles_of_region(near_by, frame, tops.zoom);
  std::erase_if(keys, [&](const TileKey& key) { return !tops.contains(key); });
  std::sort(keys.begin(), keys.end(),
            [](const TileKey& a, const TileKey& b) { return along_curve(a) < along_curve(b); });
  return keys;
}

std::vector<ZoomCount> count_tiles(std::span<const TileKey> metatiles, const TileRange& range, int min_zoom) {
  std::vector<ZoomCount> counts;
  if (metatiles.empty()) return counts;
  const int top = metatiles.front().z;
  for (int zoom = range.zoom; zoom >= top; --zoom) {
    const TileRange level = range.at_zoom(zoom);
    const int steps = zoom - top;
    ZoomCount count{zoom, 0};
    for (const TileKey& key : metatiles) {
      const auto overlap = [steps](std::uint32_t at, std::int64_t first, std::int64_t last) {
        const std::int64_t begin = std::int64_t{at} << steps, end = begin + (std::int64_t{1} << steps) - 1;
        return static_cast<std::uint64_t>(std::max<std::int64_t>(0, std::min(end, last) - std::max(begin, first) + 1));
      };
      count.tiles += overlap(key.x, level.first_x, level.last_x) * overlap(key.y, level.first_y, level.last_y);
    }
    counts.push_back(count);
  }
  std::set<TileKey> level(metatiles.begin(), metatiles.end());
  for (int zoom = top - 1; zoom >= min_zoom; --zoom) {
    std::set<TileKey> parents;
    for (const TileKey& key : level) parents.insert(key.parent());
    level = std::move(parents);
    counts.push_back({zoom, level.size()});
  }
  std::reverse(counts.begin(), counts.end());
  return counts;
}

std::vector<ZoomCount> count_whole_build(const Mission& mission) {
  const TileRange range = wanted_range(mission);
  return count_tiles(metatiles_of(mission, range), range, mission.zoom.min);
}

}  // namespace nadir
