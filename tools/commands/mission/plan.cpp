#include "commands/mission/plan.hpp"

#include <fmt/format.h>

#include <nlohmann/json.hpp>
#include <ostream>

#include "base/error.hpp"
#include "cli/options.hpp"
#include "cli/output.hpp"
#include "commands/mission/plan_estimate.hpp"

namespace nadir {
namespace {

using nlohmann::json;

std::string minutes_text(double seconds) {
  return seconds < 60 ? fmt::format("{:.0f} s", std::max(1.0, seconds)) : fmt::format("{:.1f} min", seconds / 60);
}

Findings judge_estimate(const Mission& mission, const PlanEstimate& plan) {
  Findings findings;
  const double budget_bytes = static_cast<double>(mission.budget_mb) * 1e6;
  if (plan.bytes > budget_bytes) {
    findings.add({.code = "budget.exceeded",
                  .severity = Severity::warning,
                  .where = "the estimate",
                  .expected = fmt::format("at most {} MB", mission.budget_mb),
                  .found = fmt::format("about {:.1f} MB", plan.bytes / 1e6),
                  .fix = "lower zoom.max or the quality, try webp, make the area smaller, or raise budget_mb"});
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
                {"route", fmt::format("{:.2f} km, {:.0f} m to either side: {:.2f} km²", plan.route_km,
                                      mission.route.corridor_half_width_m, plan.corridor_km2)}};
  for (const SectorPlan& sector : plan.sectors) {
    lines.emplace_back("sector " + sector.id, fmt::format("{:.2f} km² ({})", sector.km2, name_of(sector.cls)));
  }
  lines.emplace_back("needed", fmt::format("{:.2f} km² of ground, what they share counted once", plan.needed_km2));
  for (const ZoomPlan& level : plan.zooms) {
    lines.emplace_back(fmt::format("zoom {}", level.zoom),
                       fmt::format("{} tiles, {:.1f} MB; {} of them required (their bounding box has {})", level.tiles,
                                   level.bytes / 1e6, level.required, level.box_tiles));
  }
  lines.emplace_back("package", fmt::format("{} tiles, about {:.1f} MB of {} MB allowed", plan.tiles, plan.bytes / 1e6,
                                            mission.budget_mb));
  lines.emplace_back("building",
                     fmt::format("about {} with {} thread{}", minutes_text(seconds), threads, threads == 1 ? "" : "s"));
  lines.emplace_back("figures", fmt::format("{}: {:.1f} kB and {:.0f} ms per tile, measured", figures.format,
                                            figures.bytes_per_tile / 1e3, figures.cpu_ms_per_tile));
  print_figures(out, lines);
}

}  // namespace

std::string_view MissionPlanCommand::details() const {
  return "Counts the tiles that a build makes for the sectors and the corridor, with the margin around them, and "
         "those\n"
         "of them that the mission requires, zoom by zoom, and estimates the package from\n"
         "measured bytes and milliseconds per tile, which are printed as well. Real imagery differs by its content:\n"
         "expect half to one and a half times the megabytes. An estimate above the budget is a warning. Exit code 0:\n"
         "estimated; 2: the mission is not valid.";
}

std::string_view MissionPlanCommand::examples() const {
  return "nadir mission plan missions/demo-world.yaml\n"
         "nadir mission plan mission.yaml --tile-format webp --threads 8 --json";
}

void MissionPlanCommand::setup(Options& options) {
  options.positional("MISSION.yaml", mission_, "the mission file").required();
  options.value("--tile-format", tile_format_, "FORMAT", "how a tile is encoded").one_of({"jpeg", "webp", "png"});
  options.value("--threads", threads_, "N", "threads that the build will have").between(1, 256);
}

int MissionPlanCommand::run(Context& context) {
  const Mission mission = read_mission(mission_);
  const auto figures = figures_of(tile_format_);
  if (!figures) throw UsageError({.what = "no figures for this tile format", .where = tile_format_});
  const PlanEstimate plan = estimate_plan(mission, *figures);
  const double seconds = plan.cpu_seconds / threads_;
  const Findings findings = judge_estimate(mission, plan);
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

}  // namespace nadir
