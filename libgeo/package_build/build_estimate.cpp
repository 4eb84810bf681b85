#include "package_build/build_estimate.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <memory>

#include "base/ordered_work.hpp"
#include "package/coverage_requirement.hpp"
#include "package_build/build_plan.hpp"
#include "package_build/metatile.hpp"
#include "raster/single_opencv_thread.hpp"

namespace nadir {
namespace {

constexpr std::array<TileFormatFigures, 3> kFigures{{{"jpeg", 11'500, 6}, {"webp", 7'800, 12}, {"png", 98'900, 21}}};
constexpr double kContainerBytesPerTile = 1300;  // sidecar, mask, index, free space of pages; measured as well
// The same without the mask: 954 to 1063 in packages of four simulated worlds, November 2026.
constexpr double kRowBytesPerTile = 1010;
constexpr std::size_t kSampledSquares = 40;  // a sixth of scatter from square to square then leaves 3 %

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

// Everything but the bytes; tiles: of a build of these squares.
BuildEstimate estimate_ground(const Mission& mission, const std::vector<ZoomCount>& build) {
  BuildEstimate plan;
  const LocalFrame frame = mission_frame(mission);
  const Region region = required_region(mission, frame);
  for (const Sector& sector : mission.sectors) {
    plan.sectors.push_back({sector.id, sector.cls, std::abs(area_m2(to_plane(frame, sector.polygon))) / 1e6});
  }
  const Region corridor_region = corridor_of(mission.route, frame);
  for (const Corridor& corridor : corridor_region.corridors) plan.route_km += length_m(corridor.path) / 1000;
  for (int zoom = mission.zoom.min; zoom <= mission.zoom.max; ++zoom) {
    const std::vector<TileKey> tiles = required_tiles(mission, zoom);
    const auto built =
        std::find_if(build.begin(), build.end(), [zoom](const ZoomCount& of) { return of.zoom == zoom; });
    plan.zooms.push_back({zoom, built == build.end() ? 0 : built->tiles, tiles.size(), box_tiles(tiles), 0});
    if (zoom == mission.zoom.max) {
      plan.needed_km2 = area_km2(region, frame, tiles);
      plan.corridor_km2 = area_km2(corridor_region, frame, tiles);
    }
  }
  return plan;
}

void add_up(BuildEstimate& plan, const TileFormatFigures& figures) {
  for (const ZoomEstimate& level : plan.zooms) {
    plan.tiles += level.tiles;
    plan.required += level.required;
    plan.bytes += level.bytes;
  }
  plan.cpu_seconds = static_cast<double>(plan.tiles) * figures.cpu_ms_per_tile / 1000;
}

struct SampledZoom {
  std::uint64_t planned = 0;  // tiles of the sampled squares, if imagery covered everything
  std::uint64_t made = 0;
  double bytes = 0;
};

}  // namespace

std::optional<TileFormatFigures> tile_format_figures(std::string_view format) {
  const auto found = std::find_if(kFigures.begin(), kFigures.end(),
                                  [=](const TileFormatFigures& figures) { return figures.format == format; });
  return found == kFigures.end() ? std::nullopt : std::optional(*found);
}

BuildEstimate estimate_build(const Mission& mission, const TileFormatFigures& figures) {
  BuildEstimate plan = estimate_ground(mission, count_whole_build(mission));
  for (ZoomEstimate& level : plan.zooms) {
    level.bytes = static_cast<double>(level.tiles) * (figures.bytes_per_tile + kContainerBytesPerTile);
  }
  add_up(plan, figures);
  return plan;
}

BuildEstimate estimate_build(const Mission& mission, const TileFormatFigures& figures,
                             std::span<const ImageryInput> inputs, const TileSetOptions& options, Progress& progress) {
  const SingleOpenCvThread one_thread;
  const TileRange range = plan_range(mission, inputs);
  const std::vector<TileKey> squares = metatiles_of(mission, range);
  const std::vector<ZoomCount> build = count_tiles(squares, range, mission.zoom.min);
  BuildEstimate plan = estimate_ground(mission, build);
  plan.squares = squares.size();
  if (squares.empty()) return plan;

  // Squares are in Morton order: evenly spaced ones lie all over the area.
  const std::size_t sampled = std::min(squares.size(), kSampledSquares);
  plan.sampled_squares = sampled;
  std::vector<TileKey> sample;
  for (std::size_t i = 0; i < sampled; ++i) sample.push_back(squares[(2 * i + 1) * squares.size() / (2 * sampled)]);
  const TileEncoder encoder(mission, inputs, options.encoding);
  const double feather_px = feather_pixels(mission, options.mosaic);
  std::map<int, SampledZoom> zooms;
  for (const ZoomCount& of : count_tiles(sample, range, squares.front().z)) zooms[of.zoom].planned = of.tiles;
  progress.begin("sampling the imagery", sampled, "squares");
  const auto make_worker = [&]() -> std::function<Metatile(std::size_t)> {
    return [&, layers = layers_of(inputs)](std::size_t item) {
      return render_metatile(sample[item], range, layers, feather_px, encoder);
    };
  };
  work_in_order<Metatile>(sampled, options.threads, make_worker, [&](std::size_t, const Metatile& metatile) {
    for (const EncodedTile& tile : metatile.tiles) {
      SampledZoom& zoom = zooms[tile.sidecar.key.z];
      ++zoom.made;
      zoom.bytes += static_cast<double>(tile.bytes.size() + tile.sidecar.mask.size()) + kRowBytesPerTile;
    }
    progress.advance();
    return true;
  });
  progress.end();

  // Overviews above the squares are few: as many as planned, each as the coarsest that was sampled.
  const SampledZoom& coarsest = zooms.begin()->second;
  for (ZoomEstimate& level : plan.zooms) {
    const auto found = zooms.find(level.zoom);
    const SampledZoom& like = found == zooms.end() ? coarsest : found->second;
    if (like.planned == 0 || like.made == 0) {
      level.tiles = 0;
      continue;
    }
    const double share = static_cast<double>(like.made) / static_cast<double>(like.planned);
    level.tiles = static_cast<std::uint64_t>(std::llround(static_cast<double>(level.tiles) * share));
    level.bytes = static_cast<double>(level.tiles) * like.bytes / static_cast<double>(like.made);
  }
  add_up(plan, figures);
  return plan;
}

Findings check_estimate(const Mission& mission, const BuildEstimate& estimate) {
  Findings findings;
  if (estimate.bytes > static_cast<double>(mission.budget_mb) * 1e6) {
    findings.add({.code = "budget.exceeded",
                  .severity = Severity::warning,
                  .where = "the estimate",
                  .expected = fmt::format("at most {} MB", mission.budget_mb),
                  .found = fmt::format("about {:.1f} MB", estimate.bytes / 1e6),
                  .fix = "lower zoom.max or the quality, try webp, reduce the area, or raise budget_mb"});
  }
  return findings;
}

}  // namespace nadir
