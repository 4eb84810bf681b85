// nadir mission check: is this mission file sound, and what does it ask for?
#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <ostream>

#include "cli/command.hpp"
#include "cli/options.hpp"
#include "cli/output.hpp"
#include "commands/commands.hpp"
#include "package/mission.hpp"
#include "package/mission_check.hpp"

namespace nadir {
namespace {

struct Demand {
  double sectors_km2 = 0;
  double route_km = 0;
  std::uint64_t tiles = 0;  // over all zooms
};

Demand demand_of(const Mission& mission) {
  Demand demand;
  const Region region = required_region(mission, mission_frame(mission));
  for (const PlaneRing& ring : region.rings) demand.sectors_km2 += std::abs(area_m2(ring)) / 1e6;
  for (const Corridor& corridor : corridor_of(mission.route, mission_frame(mission)).corridors) {
    demand.route_km += length_m(corridor.path) / 1000;
  }
  for (int zoom = mission.zoom.min; zoom <= mission.zoom.max; ++zoom) {
    demand.tiles += required_tiles(mission, zoom).size();
  }
  return demand;
}

std::string height_text(const Route& route) {
  constexpr double kMetresPerFoot = 0.3048;
  std::string text = fmt::format("{:g} m ({:.0f} ft) above ground", route.agl_m, route.agl_m / kMetresPerFoot);
  if (!route.heights_m.empty()) {
    const auto [low, high] = std::minmax_element(route.heights_m.begin(), route.heights_m.end());
    text += fmt::format("; points {:g} to {:g} m ({:.0f} to {:.0f} ft), {}", *low, *high, *low / kMetresPerFoot,
                        *high / kMetresPerFoot, height_frames_of(route));
  }
  return text;
}

class MissionCheckCommand final : public Command {
 public:
  std::string_view group() const override { return "mission"; }
  std::string_view name() const override { return "check"; }
  std::string_view summary() const override { return "check a mission file and show its requirements"; }
  std::string_view details() const override;
  std::string_view examples() const override;
  bool offers_json() const override { return true; }

  void setup(Options& options) override;
  int run(Context& context) override;

 private:
  std::filesystem::path mission_;
};

std::string_view MissionCheckCommand::details() const {
  return R"(Reports every problem in the file with line and column.

Exit codes: 0 the mission is valid, 1 it is not, 2 the file cannot be read.)";
}

std::string_view MissionCheckCommand::examples() const { return R"(nadir mission check missions/example.yaml)"; }

void MissionCheckCommand::setup(Options& options) {
  options.positional("MISSION.yaml", mission_, "mission file").required();
}

int MissionCheckCommand::run(Context& context) {
  MissionReading reading = check_mission(mission_);
  if (!reading.mission) return report_findings(context.out, context.json, reading.findings);
  const Mission& mission = *reading.mission;
  reading.findings.add(check_expiry(mission, context.clock.now(), Severity::warning));
  reading.findings.add(check_plausibility(mission));
  const Demand demand = demand_of(mission);
  if (context.json) {
    const nlohmann::json more{{"mission", mission.id},
                              {"series", mission.series},
                              {"sequence", mission.sequence},
                              {"sectors_km2", demand.sectors_km2},
                              {"route_km", demand.route_km},
                              {"required_tiles", demand.tiles},
                              {"integrity",
                               {{"risk", mission.integrity.risk},
                                {"alert_limit_m", mission.integrity.alert_limit_m},
                                {"time_to_alert_s", mission.integrity.time_to_alert_s}}}};
    return report_findings(context.out, true, reading.findings, more);
  }
  print_figures(
      context.out,
      {{"mission", fmt::format("{} (series {}, sequence {})", mission.id, mission.series, mission.sequence)},
       {"valid", to_rfc3339(mission.created) + " to " + to_rfc3339(mission.expires)},
       {"airframes", fmt::format("{}", fmt::join(mission.airframes, ", "))},
       {"sectors", fmt::format("{}, {:.2f} km²", mission.sectors.size(), demand.sectors_km2)},
       {"route", fmt::format("{:.2f} km, {:.0f} m to each side", demand.route_km, mission.route.corridor_half_width_m)},
       {"height", height_text(mission.route)},
       {"tiles", fmt::format("{} at zooms {} to {}", demand.tiles, mission.zoom.min, mission.zoom.max)},
       {"integrity",
        fmt::format("alert limit {} m at a risk of {} a look, alert within {} s", mission.integrity.alert_limit_m,
                    mission.integrity.risk, mission.integrity.time_to_alert_s)}});
  return report_findings(context.out, false, reading.findings);
}

}  // namespace

std::unique_ptr<Command> make_mission_check() { return std::make_unique<MissionCheckCommand>(); }

}  // namespace nadir
