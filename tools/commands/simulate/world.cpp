// `nadir simulate world`: a made-up landscape to try everything with.
#include <fmt/format.h>

#include <filesystem>
#include <nlohmann/json.hpp>
#include <ostream>

#include "base/error.hpp"
#include "base/files.hpp"
#include "cli/command.hpp"
#include "cli/options.hpp"
#include "cli/output.hpp"
#include "commands/commands.hpp"
#include "simulation/world.hpp"

namespace nadir {
namespace {

class SimulateWorldCommand final : public Command {
 public:
  std::string_view group() const override { return "simulate"; }
  std::string_view name() const override { return "world"; }
  std::string_view summary() const override {
    return "create a landscape: map, ground on the day of flight, elevation";
  }
  std::string_view details() const override;
  std::string_view examples() const override;
  bool offers_json() const override { return true; }
  void setup(Options& options) override;
  int run(Context& context) override;

 private:
  WorldOptions options_;
  std::filesystem::path out_;
};

std::string_view SimulateWorldCommand::details() const {
  return R"(OUT receives ground.tif (the day of the flight), map.tif (the same land as a satellite saw it four
months earlier: other crops, sun and sensor, some roofs and fields changed), dem.tif, their STAC
Items, vectors.geojson (roads, water, woods and buildings with OpenStreetMap's tags), and a matching
mission.yaml and camera.yaml. The same seed, size and ground sample distance give the same bytes.)";
}

std::string_view SimulateWorldCommand::examples() const {
  return R"(nadir simulate world --seed 7 --size-km 2 --gsd-m 0.5 --out world)";
}

void SimulateWorldCommand::setup(Options& options) {
  options.value("--seed", options_.seed, "N", "random seed of the world");
  options.value("--size-km", options_.size_km, "S", "side length").between(0.2, 20);
  options.value("--gsd-m", options_.gsd_m, "G", "ground sample distance").between(0.1, 20);
  options.value("--out", out_, "DIR", "folder to create").required();
}

int SimulateWorldCommand::run(Context& context) {
  const double side = options_.size_km * 1000 / options_.gsd_m;
  if (side > 40000 || side < 200) {
    throw UsageError({.what = "the world would have an unusable number of pixels",
                      .where = "--size-km and --gsd-m",
                      .expected = "200 to 40000 pixels a side",
                      .found = fmt::format("{:.0f}", side),
                      .fix = "choose a coarser or finer --gsd-m"});
  }
  StagingDirectory staging(out_);
  const WorldReport report = make_world(options_, staging.path(), context.progress);
  staging.commit();
  if (context.json) {
    print_json(context.out, {{"folder", out_.string()},
                             {"side_px", report.side_px},
                             {"parcels", report.parcels},
                             {"buildings", report.buildings},
                             {"trees", report.trees},
                             {"relief_m", report.relief_m},
                             {"map_ce90_m", report.map_ce90_m}});
  } else {
    print_figures(context.out, {{"world", out_.string()},
                                {"pixels", fmt::format("{0} x {0}", report.side_px)},
                                {"parcels", fmt::format("{}", report.parcels)},
                                {"buildings", fmt::format("{}", report.buildings)},
                                {"trees", fmt::format("{}", report.trees)},
                                {"relief", fmt::format("{:.0f} m", report.relief_m)},
                                {"map CE90", fmt::format("{:.1f} m", report.map_ce90_m)}});
  }
  return kAccepted;
}

}  // namespace

std::unique_ptr<Command> make_simulate_world() { return std::make_unique<SimulateWorldCommand>(); }

}  // namespace nadir
