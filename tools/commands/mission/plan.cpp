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
#include "commands/cache/imagery_options.hpp"
#include "commands/commands.hpp"
#include "navigability/navigability_parameters.hpp"
#include "navigability/route_prediction.hpp"
#include "package/mission.hpp"
#include "package_build/build_estimate.hpp"
#include "planning/planning_room.hpp"
#include "planning/raster_tiles.hpp"
#include "raster/stretch.hpp"
#include "vision/camera.hpp"
#include "vision/matchability.hpp"

namespace nadir {
namespace {

using nlohmann::json;

std::string minutes_text(double seconds) {
  return seconds < 60 ? fmt::format("{:.0f} s", std::max(1.0, seconds)) : fmt::format("{:.1f} min", seconds / 60);
}

void print(std::ostream& out, const Mission& mission, const BuildEstimate& plan, const TileFormatFigures& figures,
           double seconds, int threads) {
  Figures lines{{"mission", mission.id},
                {"route", fmt::format("{:.2f} km, {:.0f} m to each side: {:.2f} km²", plan.route_km,
                                      mission.route.corridor_half_width_m, plan.corridor_km2)}};
  for (const SectorEstimate& sector : plan.sectors) {
    lines.emplace_back("sector " + sector.id, fmt::format("{:.2f} km² ({})", sector.km2, name_of(sector.cls)));
  }
  lines.emplace_back("needed", fmt::format("{:.2f} km² of ground, overlaps counted once", plan.needed_km2));
  for (const ZoomEstimate& level : plan.zooms) {
    lines.emplace_back(fmt::format("zoom {}", level.zoom),
                       fmt::format("{}, {:.1f} MB; {} required (bounding box: {})", count(level.tiles, "tile"),
                                   level.bytes / 1e6, level.required, level.box_tiles));
  }
  lines.emplace_back("package", fmt::format("{}, about {:.1f} MB of {} MB allowed", count(plan.tiles, "tile"),
                                            plan.bytes / 1e6, mission.budget_mb));
  lines.emplace_back("building", fmt::format("about {} with {}", minutes_text(seconds),
                                             count(static_cast<std::uint64_t>(threads), "thread")));
  if (plan.sampled_squares > 0) {
    lines.emplace_back(
        "figures", fmt::format("{} of {} of the imagery made as {}; {:.0f} ms per tile, measured", plan.sampled_squares,
                               count(plan.squares, "square"), figures.format, figures.cpu_ms_per_tile));
  } else {
    lines.emplace_back("figures", fmt::format("{}: {:.1f} kB and {:.0f} ms per tile, measured", figures.format,
                                              figures.bytes_per_tile / 1e3, figures.cpu_ms_per_tile));
  }
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
  BuildEstimate sampled(const Mission& mission, const TileFormatFigures& figures, Context& context) const;
  std::optional<RoutePrediction> predicted(const Mission& mission, Context& context) const;

  std::filesystem::path mission_;
  std::string tile_format_ = "jpeg";
  int quality_ = 75;
  std::vector<std::filesystem::path> imagery_;
  std::vector<std::string> stretches_;
  std::optional<std::filesystem::path> camera_;
  ImageryOptions imagery_options_{"priority"};
};

std::string_view MissionPlanCommand::details() const {
  return R"(Counts the tiles that a build makes for the sectors and the corridor including their margin, and
those of them that the mission requires, zoom by zoom. Estimates the package from measured bytes and
milliseconds per tile, which are printed as well. Real imagery differs with its content: expect 0.5
to 1.5 times the estimated megabytes. With --imagery up to 40 squares of 8 x 8 tiles are made of it
and thrown away: the estimate is then within 10 % of the tiles and megabytes of the build. An
estimate above the budget is a warning.

With --camera as well, looks along the route are tried on the first raster as `mission predict` tries
them on a package. A mission that no look is likely to anchor, because its frames are only a few
pixels of the map wide or the imagery has nothing to match, is a warning.

Exit codes: 0 estimated, 2 the mission is not valid.)";
}

std::string_view MissionPlanCommand::examples() const {
  return R"(nadir mission plan missions/demo-world.yaml
nadir mission plan mission.yaml --imagery map.tif
nadir mission plan mission.yaml --imagery map.tif --camera camera.yaml
nadir mission plan mission.yaml --tile-format webp --threads 8 --json)";
}

void MissionPlanCommand::setup(Options& options) {
  options.positional("MISSION.yaml", mission_, "mission file").required();
  options.value("--tile-format", tile_format_, "FORMAT", "encoding of the tiles").one_of({"jpeg", "webp", "png"});
  options.values("--imagery", imagery_, "FILE", "raster that the package would be made of: the estimate samples it");
  options.values("--stretch", stretches_, "MIN,MAX", "of 16-bit or float imagery, as for `cache build`");
  options.value("--quality", quality_, "N", "quality of JPEG and WebP tiles, with --imagery").between(1, 100);
  options.value("--camera", camera_, "FILE.yaml", "camera of the flight: looks along the route are tried as well");
  imagery_options_.setup(options);
}

BuildEstimate MissionPlanCommand::sampled(const Mission& mission, const TileFormatFigures& figures,
                                          Context& context) const {
  std::vector<StretchRequest> stretches;
  for (const std::string& text : stretches_) stretches.push_back(parse_stretch(text));
  const MosaicOptions mosaic = imagery_options_.mosaic();
  const std::vector<ImageryInput> inputs =
      in_order(open_imagery(imagery_, imagery_options_.overrides(), stretches), mosaic.order);
  TileSetOptions options;
  options.encoding = {parse_image_format(tile_format_).value_or(ImageFormat::jpeg), quality_};
  options.mosaic = mosaic;
  options.threads = imagery_options_.threads();
  return estimate_build(mission, figures, inputs, options, context.progress);
}

// Some looks along the route, over flat ground: the elevation model is not part of the plan.
std::optional<RoutePrediction> MissionPlanCommand::predicted(const Mission& mission, Context& context) const {
  if (!camera_ || imagery_.empty() || mission.route.points.empty()) return std::nullopt;
  constexpr double kLooks = 40;
  const RasterTiles tiles(imagery_.front());
  PredictionOptions options;
  const CameraFile camera = read_camera_file(*camera_);
  options.camera = camera.camera;
  options.uncertainty = camera.uncertainty;
  options.spacing_m = std::max(1.0, length_m(to_plane(mission_frame(mission), mission.route.points)) / kLooks);
  options.at = context.clock.now();
  options.threads = imagery_options_.threads();
  return predict_route(mission, tiles, {}, nullptr, options, context.progress);
}

double mean_probability(const RoutePrediction& prediction) {
  double sum = 0;
  for (const PredictedLook& look : prediction.looks) sum += look.probability;
  return prediction.looks.empty() ? 0 : sum / static_cast<double>(prediction.looks.size());
}

// A mission that no look is likely to anchor: by the size of its frames, or by what its imagery shows.
Findings check_looks(const Mission& mission, const std::optional<CameraModel>& camera,
                     const std::optional<RoutePrediction>& prediction) {
  Findings findings;
  if (mission.route.points.empty()) return findings;
  const double footprint_m = camera ? square_footprint_m(*camera, mission.route.agl_m) : mission.route.agl_m;
  const double pixel_m =
      std::max(mission.min_resolution_m, ground_resolution_m(mission.zoom.max, mission.takeoff.lat_deg));
  // Over ground that nothing resembles: the model's best.
  ProbedGround best{.footprint_m = footprint_m, .gsd_m = pixel_m, .map_gsd_m = pixel_m, .valid = 1, .ratio = 0};
  Finding finding{.code = "mission.unmatchable", .severity = Severity::warning, .where = "route"};
  if (anchor_probability(best) < parameters::navigability::kPoorLook) {
    finding.expected = "frames that show enough pixels of the map to be matched";
    finding.found = fmt::format("frames of {:.0f} m at {:g} m above ground: {:.0f} pixels of {:.2f} m", footprint_m,
                                mission.route.agl_m, footprint_m / pixel_m, pixel_m);
    finding.fix = "fly higher, or use finer imagery with a higher zoom.max";
    findings.add(std::move(finding));
  } else if (prediction && mean_probability(*prediction) < parameters::navigability::kPoorLook) {
    finding.expected = "ground along the route that frames can be matched with";
    finding.found = fmt::format("{:.0f} % of {} along the route would anchor: {}", 100 * mean_probability(*prediction),
                                count(prediction->looks.size(), "look"),
                                prediction->legs.empty() ? "" : prediction->legs.front().reason);
    finding.fix =
        "another height, another route, or fresher imagery; `nadir mission predict` says more once the "
        "package is built";
    findings.add(std::move(finding));
  }
  return findings;
}

int MissionPlanCommand::run(Context& context) {
  const Mission mission = read_mission(mission_);
  const auto figures = tile_format_figures(tile_format_);
  if (!figures) throw UsageError({.what = "no figures for this tile format", .where = tile_format_});
  const int threads = imagery_options_.threads();
  const BuildEstimate plan = imagery_.empty() ? estimate_build(mission, *figures) : sampled(mission, *figures, context);
  const double seconds = plan.cpu_seconds / threads;
  Findings findings = check_estimate(mission, plan);
  std::optional<CameraModel> camera;
  if (camera_) camera = read_camera_file(*camera_).camera;
  const std::optional<RoutePrediction> prediction = predicted(mission, context);
  findings.add(check_looks(mission, camera, prediction));
  if (context.json) {
    json document = estimate_json(plan);
    document["mission"] = mission.id;
    document["budget_mb"] = mission.budget_mb;
    document["tile_format"] = tile_format_;
    document["build_minutes"] = seconds / 60;
    if (prediction) document["anchored_looks"] = rounded(mean_probability(*prediction), 1000);
    document["bytes_per_tile"] = figures->bytes_per_tile;
    document["cpu_ms_per_tile"] = figures->cpu_ms_per_tile;
    return report_findings(context.out, true, findings, document);
  }
  print(context.out, mission, plan, *figures, seconds, threads);
  if (prediction) {
    print_figures(context.out, {{"looks", fmt::format("{:.0f} % of {} along the route would anchor",
                                                      100 * mean_probability(*prediction),
                                                      count(prediction->looks.size(), "look"))}});
  }
  if (!findings.empty()) print_findings(context.out, findings);
  return kAccepted;
}

}  // namespace

std::unique_ptr<Command> make_mission_plan() { return std::make_unique<MissionPlanCommand>(); }

}  // namespace nadir
