#include "commands/mission/plan_estimate.hpp"

#include <algorithm>
#include <array>
#include <cmath>

#include "package_build/build_plan.hpp"
#include "package/mission_check.hpp"
#include "package/coverage_requirement.hpp"

namespace nadir {
namespace {

constexpr std::array<FormatFigures, 3> kFigures{{{"jpeg", 11'500, 6}, {"webp", 7'800, 12}, {"png", 98'900, 21}}};

// By counting the needed pixels of the finest zoom.
double area_km2(const Region& region, const LocalFrame& frame, const std::vector<TileKey>& tiles) {
  const CoverageRequirement need(region);
  double area_m2 = 0;
  for (const TileKey& key : tiles) {
    const TileFootprint footprint(frame, key);
    area_m2 += static_cast<double>(need.missing_pixels(footprint, {})) * footprint.pixel_area_m2();
  }
  return area_m2 / 1e6;
}

std::uint64_t box_tiles(const std::vector<TileKey>& tiles) {
  if (tiles.empty()) return 0;
  std::uint32_t low_y = UINT32_MAX, high_y = 0;
  for (const TileKey& key : tiles) low_y = std::min(low_y, key.y), high_y = std::max(high_y, key.y);
  const std::uint64_t across = tiles.back().x - tiles.front().x + 1, down = high_y - low_y + 1;  // in the order of x
  return across * down;
}

}  // namespace

std::optional<FormatFigures> figures_of(std::string_view tile_format) {
  const auto found = std::find_if(kFigures.begin(), kFigures.end(),
                                  [=](const FormatFigures& figures) { return figures.format == tile_format; });
  return found == kFigures.end() ? std::nullopt : std::optional(*found);
}

PlanEstimate estimate_plan(const Mission& mission, const FormatFigures& figures) {
  PlanEstimate plan;
  const LocalFrame frame = mission_frame(mission);
  const Region region = required_region(mission, frame);
  for (const Sector& sector : mission.sectors) {
    plan.sectors.push_back({sector.id, sector.cls, std::abs(area_m2(to_plane(frame, sector.polygon))) / 1e6});
  }
  for (const Corridor& corridor : region.corridors) plan.route_km += length_m(corridor.path) / 1000;
  const std::vector<ZoomCount> build = count_whole_build(mission);
  for (int zoom = mission.zoom.min; zoom <= mission.zoom.max; ++zoom) {
    const std::vector<TileKey> tiles = required_tiles(mission, zoom);
    const auto built =
        std::find_if(build.begin(), build.end(), [zoom](const ZoomCount& of) { return of.zoom == zoom; });
    ZoomPlan level{zoom, built == build.end() ? 0 : built->tiles, tiles.size(), box_tiles(tiles), 0};
    level.bytes = static_cast<double>(level.tiles) * (figures.bytes_per_tile + kContainerBytesPerTile);
    plan.tiles += level.tiles;
    plan.required += level.required;
    plan.bytes += level.bytes;
    plan.zooms.push_back(level);
    if (zoom == mission.zoom.max) {
      plan.needed_km2 = area_km2(region, frame, tiles);
      plan.corridor_km2 = area_km2({{}, region.corridors}, frame, tiles);
    }
  }
  plan.cpu_seconds = static_cast<double>(plan.tiles) * figures.cpu_ms_per_tile / 1000;
  return plan;
}

}  // namespace nadir
