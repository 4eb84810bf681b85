// nadir mission predict: along which legs would the aircraft know its position?
#include <fmt/format.h>

#include <algorithm>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <optional>
#include <ostream>
#include <string>
#include <thread>

#include "base/error.hpp"
#include "base/files.hpp"
#include "cli/command.hpp"
#include "cli/options.hpp"
#include "cli/output.hpp"
#include "commands/cache/tile_set_subject.hpp"
#include "commands/commands.hpp"
#include "navigability/prediction_documents.hpp"
#include "navigability/route_prediction.hpp"
#include "package/mission_check.hpp"
#include "package/tile_container.hpp"

namespace nadir {
namespace {

class MissionPredictCommand final : public Command {
 public:
  std::string_view group() const override { return "mission"; }
  std::string_view name() const override { return "predict"; }
  std::string_view summary() const override { return "predict where a flight would know its position"; }
  std::string_view details() const override;
  std::string_view examples() const override;
  bool offers_json() const override { return true; }

  void setup(Options& options) override;
  int run(Context& context) override;

 private:
  std::filesystem::path mission_, package_, camera_;
  std::optional<double> spacing_m_, speed_mps_, interval_s_;
  double search_m_ = 100;
  std::optional<UtcTime> at_;
  std::optional<int> threads_;
  std::optional<std::filesystem::path> out_;
};

std::string_view MissionPredictCommand::details() const {
  return R"(For every frame of the planned route: the footprint, the probability that its look at the map
anchors, and the protection level that nine flights of ten would stay below: 200 flights are drawn,
with the belief that the aircraft has of its place. Legs are good, fair or poor; those beyond the mission's alert limit are
marked with the reason and with what helps: another height, a leg beside it, other imagery. Nothing
is verified.

Exit codes: 0 no leg is beyond the alert limit, 1 there are some, 2 could not be predicted.)";
}

std::string_view MissionPredictCommand::examples() const {
  return R"(nadir mission predict mission.yaml package --camera camera.yaml
nadir mission predict mission.yaml package --camera camera.yaml --out prediction.geojson --json)";
}

void MissionPredictCommand::setup(Options& options) {
  options.positional("MISSION.yaml", mission_, "mission whose route is flown").required();
  options.positional("PACKAGE", package_, "package, MBTiles file or COG that it is flown with").required();
  options.value("--camera", camera_, "FILE.yaml", "camera of the flight").required();
  options
      .value("--spacing-m", spacing_m_, "M",
             "distance between predicted looks; default: a look a frame, at most 70 % overlap")
      .between(1, 5000);
  options.value("--search-m", search_m_, "M", "search radius of the flight").between(60, 1200);
  options.value("--speed-mps", speed_mps_, "V", "ground speed (20); given, legs are in seconds as well")
      .between(1, 300);
  options.value("--interval-s", interval_s_, "S", "time between the flight's frames; default: 70 % overlap")
      .between(0.05, 60);
  options.value("--at", at_, "TIME", "evaluate the imagery's age as of this time");
  options.value("--threads", threads_, "N", "threads; default: one per processor").between(1, 256);
  options.value("--out", out_, "FILE.geojson", "legs and frames as GeoJSON");
}

std::string where_text(const RoutePrediction& prediction, const PredictedLeg& leg,
                       const std::optional<double>& speed_mps) {
  const LonLat& from = prediction.looks[leg.first].place;
  const LonLat& to = prediction.looks[leg.last].place;
  std::string text = fmt::format("from {:.0f} m for {:.0f} m", leg.begin_m, leg.length_m);
  if (speed_mps) text += fmt::format(" ({:.0f} s)", leg.length_m / *speed_mps);
  return text + fmt::format(", {:.6f},{:.6f} to {:.6f},{:.6f}", from.lon_deg, from.lat_deg, to.lon_deg, to.lat_deg);
}

void print(std::ostream& out, const RoutePrediction& prediction, const std::optional<double>& speed_mps) {
  const auto share = [&](double length_m) {
    return fmt::format("{:.0f} m, {:.0f} % of the route", length_m,
                       prediction.route_m > 0 ? 100 * length_m / prediction.route_m : 0);
  };
  const auto level_text = [](const std::optional<double>& hpl_m) {
    return hpl_m ? fmt::format("{:.0f} m", *hpl_m) : "unknown";
  };
  std::optional<double> worst_m = 0;
  for (const PredictedLook& look : prediction.looks) {
    if (look.at_m < prediction.start_m) continue;
    worst_m = worst_m && look.hpl_m ? std::optional(std::max(*worst_m, *look.hpl_m)) : std::nullopt;
  }
  print_figures(out, {{"route", fmt::format("{:.0f} m, {} {:.0f} m apart", prediction.route_m,
                                            count(prediction.looks.size(), "frame"), prediction.spacing_m)},
                      {"start confirmed after", prediction.start_m < prediction.route_m
                                                    ? fmt::format("{:.0f} m", prediction.start_m)
                                                    : "nothing: the level never comes within the limit"},
                      {"good", share(prediction.good_m)},
                      {"fair", share(prediction.fair_m)},
                      {"poor", share(prediction.poor_m)},
                      {"beyond the alert limit",
                       fmt::format("{} (limit {:g} m, largest level after the start {})", share(prediction.beyond_m),
                                   prediction.alert_limit_m, level_text(worst_m))}});
  for (const PredictedLeg& leg : prediction.legs) {
    if (leg.verdict == LegVerdict::good && !leg.beyond_alert_limit) continue;
    out << fmt::format("{}{}: {}\n  {:.0f} % of the looks anchor, {}: {}\n", name_of(leg.verdict),
                       leg.beyond_alert_limit ? ", beyond the alert limit" : "", where_text(prediction, leg, speed_mps),
                       100 * leg.anchored_share,
                       leg.hpl_m ? "protection level up to " + level_text(leg.hpl_m) : "no protection level",
                       leg.reason);
    for (const std::string& remedy : leg.remedies) out << "  helps: " << remedy << '\n';
  }
}

int MissionPredictCommand::run(Context& context) {
  const Mission mission = read_mission(mission_);
  const TileSetSubject subject = find_tile_set(package_);
  PredictionOptions options;
  const CameraFile camera = read_camera_file(camera_);
  options.camera = camera.camera;
  options.uncertainty = camera.uncertainty;
  options.speed_mps = speed_mps_;
  options.interval_s = interval_s_;
  options.spacing_m = spacing_m_;
  options.search_m = search_m_;
  options.at = evaluation_time(at_, context.clock);
  options.threads = threads_.value_or(static_cast<int>(std::max(1U, std::thread::hardware_concurrency())));
  TerrainReading terrain;
  if (subject.manifest) terrain = read_package_terrain(Directory(package_), *subject.manifest, mission);
  if (terrain.findings.has_errors()) return report_findings(context.out, context.json, terrain.findings);
  const std::unique_ptr<TileSource> tiles = open_tile_source(subject.tiles);
  std::vector<Sidecar> sidecars;
  const auto container = open_tile_container(subject.tiles);
  if (container->sidecars() != nullptr) sidecars = read_sidecars(*container->sidecars()).sidecars;
  const RoutePrediction prediction = predict_route(
      mission, *tiles, sidecars, terrain.terrain ? &*terrain.terrain : nullptr, options, context.progress);
  if (out_) write_file_atomic(*out_, prediction_geojson(prediction).dump() + "\n");
  if (context.json) {
    print_json(context.out, prediction_json(prediction));
  } else {
    print(context.out, prediction, speed_mps_);
  }
  if (!prediction.terrain_known && !context.quiet) {
    context.err << "note: the heights are above sea level or take-off, and the package has no terrain: taken as if the "
                   "ground were flat\n";
  }
  return prediction.beyond_m > 0 ? kRefused : kAccepted;
}

}  // namespace

std::unique_ptr<Command> make_mission_predict() { return std::make_unique<MissionPredictCommand>(); }

}  // namespace nadir
