// nadir mission plan: how large a package will be, and how long its building takes, before anything is built.
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <optional>
#include <ostream>
#include <string>
#include <string_view>
#include <vector>

#include "base/error.hpp"
#include "cli/command.hpp"
#include "cli/options.hpp"
#include "cli/output.hpp"
#include "commands/commands.hpp"
#include "package/coverage_requirement.hpp"
#include "package/mission.hpp"
#include "package/mission_check.hpp"
#include "package_build/build_plan.hpp"

namespace nadir {
namespace {

// What a mission asks for in tiles, ground, bytes and seconds, by figures that were measured once.
//
// The required tile set is that of the sectors and of the corridor, which is the route widened in metres of the local
// plane; the bounding box is counted beside it to show the difference.

// Measured with `nadir cache build`, quality 75, on 145 tiles (zooms 15 to 19) of satellite imagery of a small town
// with fields, on one core of a server of 2023. Forests and towns take up to half more bytes, water and desert far
// less.
struct FormatFigures {
  std::string_view format;
  double bytes_per_tile = 0;
  double cpu_ms_per_tile = 0;  // warping, overviews, encoding, hashing
};
constexpr double kContainerBytesPerTile = 1300;  // sidecar, mask, index, free space of pages; measured as well

struct ZoomPlan {
  int zoom = 0;
  std::uint64_t tiles = 0;      // that a build makes where imagery covers everything: with its margin
  std::uint64_t required = 0;   // of them, those that the mission requires
  std::uint64_t box_tiles = 0;  // of the bounding box of these
  double bytes = 0;
};

struct SectorPlan {
  std::string id;
  SectorClass cls = SectorClass::active;
  double km2 = 0;
};

struct PlanEstimate {
  std::vector<ZoomPlan> zooms;
  std::vector<SectorPlan> sectors;
  double route_km = 0;
  double corridor_km2 = 0;  // route and round ends widened; where it crosses itself counted once
  double needed_km2 = 0;    // sectors and corridor together, what they share counted once
  std::uint64_t tiles = 0;  // of all zooms
  std::uint64_t required = 0;
  double bytes = 0;
  double cpu_seconds = 0;
};

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
  const Region corridor_region = corridor_of(mission.route, frame);
  for (const Corridor& corridor : corridor_region.corridors) plan.route_km += length_m(corridor.path) / 1000;
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
      plan.corridor_km2 = area_km2(corridor_region, frame, tiles);
    }
  }
  plan.cpu_seconds = static_cast<double>(plan.tiles) * figures.cpu_ms_per_tile / 1000;
  return plan;
}

using nlohmann::json;

std::string minutes_text(double seconds) {
  return seconds < 60 ? fmt::format("{:.0f} s", std::max(1.0, seconds)) : fmt::format("{:.1f} min", seconds / 60);
}

Findings check_budget(const Mission& mission, const PlanEstimate& plan) {
  Findings findings;
  const double budget_bytes = static_cast<double>(mission.budget_mb) * 1e6;
  if (plan.bytes > budget_bytes) {
    findings.add({.code = "budget.exceeded",
                  .severity = Severity::warning,
                  .where = "the estimate",
                  .expected = fmt::format("at most {} MB", mission.budget_mb),
                  .found = fmt::format("about {:.1f} MB", plan.bytes / 1e6),
                  .fix = "lower zoom.max or the quality, try webp, reduce the area, or raise budget_mb"});
  }
  return findings;
}

json json_from(const PlanEstimate& plan) {
  json zooms = json::array(), sectors = json::array();
  for (const ZoomPlan& level : plan.zooms) {
    zooms.push_back({{"zoom", level.zoom},
                     {"tiles", level.tiles},
                     {"required_tiles", level.required},
                     {"bounding_box_tiles", level.box_tiles},
                     {"megabytes", level.bytes / 1e6}});
  }
  for (const SectorPlan& sector : plan.sectors) {
    sectors.push_back({{"id", sector.id}, {"class", name_of(sector.cls)}, {"km2", sector.km2}});
  }
  return {{"zooms", zooms},
          {"sectors", sectors},
          {"route_km", plan.route_km},
          {"corridor_km2", plan.corridor_km2},
          {"needed_km2", plan.needed_km2},
          {"tiles", plan.tiles},
          {"required_tiles", plan.required},
          {"megabytes", plan.bytes / 1e6}};
}

void print(std::ostream& out, const Mission& mission, const PlanEstimate& plan, const FormatFigures& figures,
           double seconds, int threads) {
  Figures lines{{"mission", mission.id},
                {"route", fmt::format("{:.2f} km, {:.0f} m to each side: {:.2f} km²", plan.route_km,
                                      mission.route.corridor_half_width_m, plan.corridor_km2)}};
  for (const SectorPlan& sector : plan.sectors) {
    lines.emplace_back("sector " + sector.id, fmt::format("{:.2f} km² ({})", sector.km2, name_of(sector.cls)));
  }
  lines.emplace_back("needed", fmt::format("{:.2f} km² of ground, overlaps counted once", plan.needed_km2));
  for (const ZoomPlan& level : plan.zooms) {
    lines.emplace_back(fmt::format("zoom {}", level.zoom),
                       fmt::format("{}, {:.1f} MB; {} required (bounding box: {})", count(level.tiles, "tile"),
                                   level.bytes / 1e6, level.required, level.box_tiles));
  }
  lines.emplace_back("package", fmt::format("{}, about {:.1f} MB of {} MB allowed", count(plan.tiles, "tile"),
                                            plan.bytes / 1e6, mission.budget_mb));
  lines.emplace_back("building", fmt::format("about {} with {}", minutes_text(seconds),
                                             count(static_cast<std::uint64_t>(threads), "thread")));
  lines.emplace_back("figures", fmt::format("{}: {:.1f} kB and {:.0f} ms per tile, measured", figures.format,
                                            figures.bytes_per_tile / 1e3, figures.cpu_ms_per_tile));
  print_figures(out, lines);
}

class MissionPlanCommand final : public Command {
 public:
  std::string_view group() const override { return "mission"; }
  std::string_view name() const override { return "plan"; }
  std::string_view summary() const override { return "estimate tiles, megabytes and minutes before building"; }
  std::string_view details() const override;
  std::string_view examples() const override;
  bool offers_json() const override { return true; }

  void setup(Options& options) override;
  int run(Context& context) override;

 private:
  std::filesystem::path mission_;
  std::string tile_format_ = "jpeg";
  int threads_ = 1;
};

std::string_view MissionPlanCommand::details() const {
  return R"(Counts the tiles that a build makes for the sectors and the corridor including their margin, and
those of them that the mission requires, zoom by zoom. Estimates the package from measured bytes and
milliseconds per tile, which are printed as well. Real imagery differs with its content: expect 0.5
to 1.5 times the estimated megabytes. An estimate above the budget is a warning.

Exit codes: 0 estimated, 2 the mission is not valid.)";
}

std::string_view MissionPlanCommand::examples() const {
  return R"(nadir mission plan missions/demo-world.yaml
nadir mission plan mission.yaml --tile-format webp --threads 8 --json)";
}

void MissionPlanCommand::setup(Options& options) {
  options.positional("MISSION.yaml", mission_, "mission file").required();
  options.value("--tile-format", tile_format_, "FORMAT", "encoding of the tiles").one_of({"jpeg", "webp", "png"});
  options.value("--threads", threads_, "N", "threads of the build").between(1, 256);
}

int MissionPlanCommand::run(Context& context) {
  const Mission mission = read_mission(mission_);
  const auto figures = figures_of(tile_format_);
  if (!figures) throw UsageError({.what = "no figures for this tile format", .where = tile_format_});
  const PlanEstimate plan = estimate_plan(mission, *figures);
  const double seconds = plan.cpu_seconds / threads_;
  const Findings findings = check_budget(mission, plan);
  if (context.json) {
    json document = json_from(plan);
    document["mission"] = mission.id;
    document["budget_mb"] = mission.budget_mb;
    document["tile_format"] = tile_format_;
    document["build_minutes"] = seconds / 60;
    document["bytes_per_tile"] = figures->bytes_per_tile;
    document["cpu_ms_per_tile"] = figures->cpu_ms_per_tile;
    return report_findings(context.out, true, findings, document);
  }
  print(context.out, mission, plan, *figures, seconds, threads_);
  if (!findings.empty()) print_findings(context.out, findings);
  return kAccepted;
}

}  // namespace

std::unique_ptr<Command> make_mission_plan() { return std::make_unique<MissionPlanCommand>(); }

}  // namespace nadir
