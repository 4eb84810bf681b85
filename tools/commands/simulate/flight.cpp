// `nadir simulate flight`: a flight over any georeferenced picture.
#include <fmt/format.h>

#include <nlohmann/json.hpp>
#include <ostream>

#include "base/files.hpp"
#include "cli/command.hpp"
#include "cli/options.hpp"
#include "cli/output.hpp"
#include "commands/commands.hpp"
#include "simulation/flight.hpp"

namespace nadir {
namespace {

class SimulateFlightCommand final : public Command {
 public:
  std::string_view group() const override { return "simulate"; }
  std::string_view name() const override { return "flight"; }
  std::string_view summary() const override {
    return "fly a mission over a raster: frames, telemetry and ground truth";
  }
  std::string_view details() const override;
  std::string_view examples() const override;
  bool offers_json() const override { return true; }
  void setup(Options& options) override;
  int run(Context& context) override;

 private:
  SimulatedFlightOptions options_;
  std::filesystem::path mission_;
  std::string noise_ = "real";
  std::filesystem::path out_;
};

std::string_view SimulateFlightCommand::details() const {
  return R"(Flies the mission's route over a georeferenced raster and takes nadir images: turns are rounded and
banked, the airframe sways, lens, shutter and sensor leave their artefacts. OUT receives frames/,
telemetry.csv, truth.csv and camera.yaml, as `nadir replay` reads them; with --imu-hz imu.csv too, of a
MEMS sensor.

With --noise real the telemetry has the errors of real sensors, according to the camera file's
uncertainty; with --noise none images and telemetry are exact.)";
}

std::string_view SimulateFlightCommand::examples() const {
  return R"(nadir simulate flight --world world/ground.tif --dem world/dem.tif --mission world/mission.yaml --camera world/camera.yaml --seed 7 --out flight)";
}

void SimulateFlightCommand::setup(Options& options) {
  options.value("--world", options_.world, "FILE.tif", "georeferenced image of the ground").required();
  options.value("--dem", options_.dem, "FILE", "elevation model above sea level; default: flat ground");
  options.value("--mission", mission_, "MISSION.yaml", "mission whose route is flown").required();
  options.value("--camera", options_.camera, "FILE.yaml", "camera model and uncertainty of the telemetry").required();
  options.value("--out", out_, "DIR", "folder to create").required();
  options.value("--seed", options_.seed, "N", "random seed of the flight");
  options.value("--noise", noise_, "none|real", "errors of camera and telemetry").one_of({"none", "real"});
  options.value("--max-frames", options_.max_frames, "N", "maximum number of frames; default: 400")
      .between(1, 100000)
      .formerly("--frames");
  options.value("--interval-s", options_.interval_s, "S", "time between frames; default: 70 % overlap")
      .between(0.01, 3600);
  options.value("--imu-hz", options_.imu_hz, "N", "samples a second of an inertial sensor; default: none")
      .between(20, 1000);
  options.value("--speed-mps", options_.speed_mps, "V", "ground speed").between(1, 300);
}

int SimulateFlightCommand::run(Context& context) {
  options_.noise = noise_ == "none" ? SensorNoise::none : SensorNoise::real;
  const Mission mission = read_mission(mission_);
  StagingDirectory staging(out_);
  const FlightReport report = simulate_flight(mission, options_, staging.path(), context.progress);
  staging.commit();
  if (!mission.terrain.flat && !options_.dem && !context.quiet) {
    context.err << "the mission has terrain, but this flight is over flat ground: give --dem\n";
  }
  if (report.frames_beyond_world > 0 && !context.quiet) {
    context.err << fmt::format(
        "{} beyond the edge of the world; the missing part is grey\n",
        count(static_cast<std::uint64_t>(report.frames_beyond_world), "frame looks", "frames look"));
  }
  if (context.json) {
    print_json(context.out, {{"folder", out_.string()},
                             {"frames", report.frames},
                             {"frames_beyond_world", report.frames_beyond_world},
                             {"length_m", report.length_m},
                             {"duration_s", report.duration_s},
                             {"interval_s", report.interval_s}});
  } else {
    print_figures(context.out, {{"flight", out_.string()},
                                {"frames", fmt::format("{}", report.frames)},
                                {"interval", fmt::format("{:.2f} s", report.interval_s)},
                                {"length", fmt::format("{:.0f} m", report.length_m)},
                                {"duration", fmt::format("{:.0f} s", report.duration_s)}});
  }
  return kAccepted;
}

}  // namespace

std::unique_ptr<Command> make_simulate_flight() { return std::make_unique<SimulateFlightCommand>(); }

}  // namespace nadir
