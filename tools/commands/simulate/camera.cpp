// `nadir simulate camera`: pictures in real time of what an autopilot's simulator flies over.
#include <fmt/format.h>

#include <memory>
#include <nlohmann/json.hpp>
#include <opencv2/core/utility.hpp>
#include <ostream>

#include "base/error.hpp"
#include "cli/command.hpp"
#include "cli/options.hpp"
#include "cli/output.hpp"
#include "cli/terminal.hpp"
#include "commands/commands.hpp"
#include "commands/simulate/mavlink_poses.hpp"
#include "simulation/camera_simulation.hpp"
#include "simulation/frame_sink.hpp"

namespace nadir {
namespace {

class SimulateCameraCommand final : public Command {
 public:
  std::string_view group() const override { return "simulate"; }
  std::string_view name() const override { return "camera"; }
  std::string_view summary() const override { return "render the view of a simulated aircraft's camera in real time"; }
  std::string_view details() const override;
  std::string_view examples() const override;
  bool offers_json() const override { return true; }
  void setup(Options& options) override;
  int run(Context& context) override;

 private:
  void report(Context& context, const CameraSimulationReport& report, bool on_stdout) const;

  LiveCameraOptions camera_;
  CameraSimulationOptions film_;
  std::string poses_;
  std::string noise_ = "real";
  std::filesystem::path out_;
  std::optional<int> keep_;
  std::optional<double> delay_s_, wait_s_;
};

std::string_view SimulateCameraCommand::details() const {
  return R"(Renders nadir images at the poses of a MAVLink stream: SIM_STATE of a simulator, or
GLOBAL_POSITION_INT with ATTITUDE. In a folder each appears complete, as frame_MICROSECONDS.jpg;
with --out - they follow each other on standard output as multipart/x-mixed-replace.

URL: udpin:HOST:PORT, udpout:HOST:PORT, tcp:HOST:PORT or serial:DEVICE:BAUD. The command ends after
--max-frames, --duration-s or --timeout-s, or on Ctrl-C.)";
}

std::string_view SimulateCameraCommand::examples() const {
  return R"(nadir simulate camera --world world/ground.tif --dem world/dem.tif --camera world/camera.yaml --pose-from udpin:127.0.0.1:14560 --out frames --keep 50
nadir simulate camera --world map.tif --camera camera.yaml --pose-from tcp:127.0.0.1:5762 --out - | ffplay -f mpjpeg -)";
}

void SimulateCameraCommand::setup(Options& options) {
  options.value("--world", camera_.world, "FILE.tif", "georeferenced image of the ground").required();
  options.value("--dem", camera_.dem, "FILE", "elevation model above sea level; default: flat ground");
  options.value("--ground-m", camera_.ground_m, "H", "height of flat ground above sea level").between(-500, 9000);
  options.value("--camera", camera_.camera, "FILE.yaml", "camera file").required();
  options.value("--pose-from", poses_, "URL", "MAVLink stream with the camera's poses").required();
  options.value("--out", out_, "DIR|-", "folder, created if missing, or standard output").required();
  options.value("--fps", film_.fps, "N", "frames per second of the stream's own time").between(0.01, 120);
  options.value("--max-frames", film_.max_frames, "N", "stop after this number of frames").between(1, 1e9);
  options.value("--duration-s", film_.seconds, "S", "stop after this time, in the stream's own time")
      .between(0.001, 1e9)
      .formerly("--seconds");
  options.value("--delay-s", delay_s_, "S", "constant delay from a pose to its image; default: as fast as possible")
      .between(0.001, 10);
  options.value("--timeout-s", wait_s_, "S", "stop when no pose arrives for this time; default: never")
      .between(0.1, 86400)
      .formerly("--wait-s");
  options.value("--keep", keep_, "N", "keep at most this number of its own frames in the folder").between(1, 1e9);
  options.value("--quality", film_.quality, "N", "JPEG quality").between(1, 100);
  options.value("--seed", camera_.seed, "N", "random seed for light and noise");
  options.value("--noise", noise_, "none|real", "lens and sensor effects").one_of({"none", "real"});
}

int SimulateCameraCommand::run(Context& context) {
  const bool on_stdout = out_ == "-";
  if (on_stdout && context.json) {
    throw UsageError({.what = "--json and --out - both use standard output", .fix = "omit one of them"});
  }
  camera_.noise = noise_ == "none" ? SensorNoise::none : SensorNoise::real;
  if (wait_s_) film_.pose_timeout = std::chrono::milliseconds(static_cast<std::int64_t>(*wait_s_ * 1000));
  if (delay_s_) film_.delay = std::chrono::milliseconds(static_cast<std::int64_t>(*delay_s_ * 1000));
  cv::setNumThreads(1);  // the other cores belong to those who fly
  MavlinkPoseSource poses(poses_);
  const LiveCamera camera(camera_);
  std::unique_ptr<FrameSink> sink;
  if (on_stdout) {
    sink = std::make_unique<FrameStream>(context.out);
  } else {
    sink = std::make_unique<FrameFolder>(out_, keep_);
  }
  if (!context.quiet) context.err << fmt::format("world loaded; waiting for poses from {}\n", poses_);
  const CameraSimulationReport film_report = run_camera_simulation(camera, poses, *sink, film_, interrupt_requested);
  if (film_report.frames == 0 && film_report.end == CameraSimulationEnd::no_poses) {
    throw Error({.what = "no pose received",
                 .where = poses_,
                 .expected = "SIM_STATE, or GLOBAL_POSITION_INT and ATTITUDE",
                 .found = fmt::format("none in {} s", *wait_s_),
                 .fix = "check the address, and that the simulator sends to it"});
  }
  report(context, film_report, on_stdout);
  throw_if_interrupted();
  return kAccepted;
}

void SimulateCameraCommand::report(Context& context, const CameraSimulationReport& report, bool on_stdout) const {
  const double cpu_ms = report.frames > 0 ? 1000 * report.cpu_s / report.frames : 0;
  if (context.json) {
    print_json(context.out, {{"folder", out_.string()},
                             {"frames", report.frames},
                             {"frames_beyond_world", report.frames_beyond_world},
                             {"frames_missed", report.frames_missed},
                             {"frames_late", report.frames_late},
                             {"duration_s", report.seconds},
                             {"cpu_ms_per_frame", cpu_ms}});
    return;
  }
  if (on_stdout && context.quiet) return;
  print_figures(on_stdout ? context.err : context.out,
                {{"frames", fmt::format("{}", report.frames)},
                 {"beyond the world", fmt::format("{}", report.frames_beyond_world)},
                 {"missed", fmt::format("{}", report.frames_missed)},
                 {"late", fmt::format("{}", report.frames_late)},
                 {"duration", fmt::format("{:.1f} s", report.seconds)},
                 {"CPU time per frame", fmt::format("{:.0f} ms", cpu_ms)}});
}

}  // namespace

std::unique_ptr<Command> make_simulate_camera() { return std::make_unique<SimulateCameraCommand>(); }

}  // namespace nadir
