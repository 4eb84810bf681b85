// `nadir simulate loop`: an aircraft that flies by nadird's positions, over a made-up landscape, with one command.
#include <arpa/inet.h>
#include <fmt/format.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <unistd.h>

#include <cerrno>
#include <cmath>
#include <cstdlib>
#include <nlohmann/json.hpp>
#include <ostream>
#include <sstream>

#include "base/error.hpp"
#include "base/input_file.hpp"
#include "base/time.hpp"
#include "cli/command.hpp"
#include "cli/options.hpp"
#include "cli/output.hpp"
#include "cli/terminal.hpp"
#include "commands/commands.hpp"
#include "commands/scratch_folder.hpp"
#include "commands/simulate/background_program.hpp"
#include "commands/simulate/loop_flight.hpp"
#include "commands/simulate/loop_inputs.hpp"
#include "nadird_client/nadird_client.hpp"

namespace nadir {
namespace {

namespace fs = std::filesystem;

constexpr double kTurnRadius_m = 130, kFlyableTurn_m = 90;  // 22 m/s, 38° of bank and the wind need that much
constexpr double kStart_s = 60;                             // for camera and nadird, on a busy machine

class SimulateLoopCommand final : public Command {
 public:
  std::string_view group() const override { return "simulate"; }
  std::string_view name() const override { return "loop"; }
  std::string_view summary() const override { return "fly a simulated aircraft by nadird's positions, in real time"; }
  std::string_view details() const override;
  std::string_view examples() const override;
  bool offers_json() const override { return true; }
  void setup(Options& options) override;
  int run(Context& context) override;

 private:
  LoopFigures fly(const LoopInputs& inputs, const fs::path& nadir, const fs::path& nadird, const fs::path& folder,
                  const std::string& listen, Context& context) const;
  std::vector<std::string> camera_call(const fs::path& nadir, const LoopInputs& inputs, const std::string& truth,
                                       const fs::path& frames) const;
  void report(Context& context, const LoopFigures& figures, const std::string& page) const;
  AutopilotType autopilot_type() const { return autopilot_ == "px4" ? AutopilotType::px4 : AutopilotType::ardupilot; }

  std::optional<fs::path> world_, out_, nadird_;
  std::vector<std::string> ground_stations_;
  std::string autopilot_ = "ardupilot", circumstance_ = "denied";
  double minutes_ = 4, fps_ = 3;
  int port_ = 8750;
  std::uint64_t seed_ = 1;
};

std::string_view SimulateLoopCommand::details() const {
  return R"(Starts a camera over a landscape, nadird with a signed map of it, and a simulated aircraft that
flies laps by the positions that nadird sends. After a minute (a third of a shorter flight) GPS
fails. The address of nadird's page is printed at the start, and at the end how far the positions
were from the truth, how far the aircraft was from its plan, and for how long none was usable.

--circumstance: denied, no GPS; spoofed, GPS says 300 m from the truth; blackout, no GPS, and after
another minute no frames for 15 s.

Without --out everything is removed at the end. Needs nadird: beside nadir, or where --nadird says.)";
}

std::string_view SimulateLoopCommand::examples() const {
  return R"(nadir simulate loop
nadir simulate loop --autopilot px4 --circumstance spoofed --minutes 5 --out flown
nadir simulate loop --world flown/world --circumstance blackout)";
}

void SimulateLoopCommand::setup(Options& options) {
  options.value("--world", world_, "DIR", "landscape of `nadir simulate world`; default: one of 2 × 2 km is made");
  options.value("--autopilot", autopilot_, "NAME", "what the aircraft speaks").one_of({"ardupilot", "px4"});
  options.value("--circumstance", circumstance_, "NAME", "what goes wrong").one_of({"denied", "spoofed", "blackout"});
  options.value("--minutes", minutes_, "N", "duration of the flight").between(0.2, 600);
  options.value("--port", port_, "N", "of nadird's page on this machine; 0: any free one").between(0, 65535);
  options.value("--out", out_, "DIR", "folder to create, with world, package, recording and track.csv");
  options.value("--fps", fps_, "N", "frames per second").between(0.5, 30);
  options.value("--seed", seed_, "N", "random seed of the flight");
  options.values("--ground-station", ground_stations_, "URL",
                 "a ground station that nadird serves too, as its own option: udpout:127.0.0.1:14550");
  options.value("--nadird", nadird_, "FILE", "the program nadird; default: beside nadir, or on the PATH");
}

// Of the loopback address, before nadird asks for it: in flight it would wait for a taken one.
int free_page_port(int wanted) {
  const FileDescriptor end(::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0));
  const int on = 1;
  ::setsockopt(end.get(), SOL_SOCKET, SO_REUSEADDR, &on, sizeof on);
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  address.sin_port = htons(static_cast<std::uint16_t>(wanted));
  socklen_t size = sizeof address;
  auto* generic = reinterpret_cast<sockaddr*>(&address);
  if (::bind(end.get(), generic, size) != 0 || ::getsockname(end.get(), generic, &size) != 0) {
    throw UsageError({.what = "the port of nadird's page cannot be used",
                      .where = fmt::format("127.0.0.1:{}", wanted),
                      .found = system_error_text(errno),
                      .fix = "choose another --port, or 0 for any free one"});
  }
  return ntohs(address.sin_port);
}

bool runs(const fs::path& program) { return ::access(program.c_str(), X_OK) == 0 && !fs::is_directory(program); }

fs::path find_nadird(const std::optional<fs::path>& given, const fs::path& nadir) {
  std::vector<fs::path> places{nadir.parent_path() / "nadird"};
  const char* path = std::getenv("PATH");
  std::istringstream folders(path == nullptr ? "" : path);
  for (std::string folder; std::getline(folders, folder, ':');) places.push_back(fs::path(folder) / "nadird");
  if (given) places = {fs::absolute(*given)};
  for (const fs::path& place : places) {
    if (runs(place)) return place;
  }
  throw UsageError({.what = "nadird is not there",
                    .where = given ? given->string() : "beside nadir and on the PATH",
                    .expected = "the program of the aircraft",
                    .fix = given ? "correct --nadird" : "install the package nadird, or give --nadird"});
}

// Until nadird's page answers.
void wait_for_page(const std::string& page, const BackgroundProgram& service) {
  const NadirdClient client(page, {}, std::chrono::seconds(2));
  for (const auto until = std::chrono::steady_clock::now() + std::chrono::duration<double>(kStart_s);;) {
    throw_if_interrupted();
    service.must_be_running();
    try {
      client.get("/v1/state");
      return;
    } catch (const Error&) {
      if (std::chrono::steady_clock::now() > until) throw;
    }
    std::this_thread::sleep_for(std::chrono::milliseconds(100));
  }
}

std::string page_of(const std::string& listen) { return "http://" + listen; }

// What the aircraft sees, by the poses that it sends to `truth`.
std::vector<std::string> SimulateLoopCommand::camera_call(const fs::path& nadir, const LoopInputs& inputs,
                                                          const std::string& truth, const fs::path& frames) const {
  const auto in_world = [&](const char* name) { return (inputs.world / name).string(); };
  return {nadir.string(),
          "simulate",
          "camera",
          "--world",
          in_world("ground.tif"),
          "--dem",
          in_world("dem.tif"),
          "--camera",
          in_world("camera.yaml"),
          "--pose-from",
          truth,
          "--out",
          frames.string(),
          "--fps",
          fmt::format("{}", fps_),
          "--keep",
          "30",
          "--delay-s",
          fmt::format("{}", kLoopCaptureDelay_s),
          "--json"};
}

// start: as one who takes off knows it.
std::vector<std::string> nadird_call(const fs::path& nadird, const LoopInputs& inputs, const std::string& autopilot,
                                     const std::string& listen, const fs::path& folder, LonLat start) {
  return {nadird.string(),
          "--package",
          inputs.package.string(),
          "--trust",
          inputs.trust.string(),
          "--at",
          to_rfc3339(inputs.mission.created),
          "--airframe",
          inputs.airframe.string(),
          "--state",
          (folder / "state").string(),
          "--camera",
          "folder:" + (folder / "frames").string(),
          "--autopilot",
          autopilot,
          "--unsigned-link",
          "--record",
          (folder / "record").string(),
          "--listen",
          listen,
          fmt::format("--start={:.7f},{:.7f}", start.lon_deg, start.lat_deg)};
}

Circuit circuit_of(const LoopInputs& inputs, const LocalFrame& frame) {
  std::vector<PlanePoint> corners;
  for (const LonLat& corner : inputs.circuit) corners.push_back(frame.plane_from_lonlat(corner));
  return Circuit(corners, kTurnRadius_m);
}

int SimulateLoopCommand::run(Context& context) {
  const fs::path nadir = fs::read_symlink("/proc/self/exe"), nadird = find_nadird(nadird_, nadir);
  const std::string listen = fmt::format("127.0.0.1:{}", free_page_port(port_));
  if (out_ && fs::exists(*out_)) {
    throw UsageError({.what = "the folder exists", .where = out_->string(), .fix = "choose another --out"});
  }
  if (world_) read_mission(*world_ / "mission.yaml");  // a wrong name is found before anything is made
  std::optional<ScratchFolder> scratch;
  if (out_) fs::create_directories(*out_);
  if (!out_) scratch.emplace("nadir-loop");
  const fs::path folder = out_ ? fs::absolute(*out_) : scratch->path();
  const LoopInputs inputs = [&] {
    try {
      return make_loop_inputs(nadir, world_, LoopAutopilot::provisioned(autopilot_type()), folder, context);
    } catch (...) {
      std::error_code ignored;
      if (out_) fs::remove_all(folder, ignored);
      throw;
    }
  }();
  const LoopFigures figures = fly(inputs, nadir, nadird, folder, listen, context);
  report(context, figures, page_of(listen));
  throw_if_interrupted();
  return kAccepted;
}

LoopFigures SimulateLoopCommand::fly(const LoopInputs& inputs, const fs::path& nadir, const fs::path& nadird,
                                     const fs::path& folder, const std::string& listen, Context& context) const {
  const std::string page = page_of(listen);
  const bool px4 = autopilot_type() == AutopilotType::px4;
  const LocalFrame frame(inputs.mission.takeoff, inputs.altitude_m);
  AircraftOptions options;
  options.altitude_m = inputs.altitude_m;
  options.rule = px4 ? PositionRule::side_by_side : PositionRule::given_first;
  options.seed = seed_;
  SimulatedAircraft aircraft(circuit_of(inputs, frame), options);
  if (aircraft.circuit().tightest_turn_m() < kFlyableTurn_m && !context.quiet) {
    context.err << fmt::format(
        "the world is small: corners of {:.0f} m are tighter than the aircraft can turn, it will leave its plan "
        "there\n",
        aircraft.circuit().tightest_turn_m());
  }
  LoopAutopilot autopilot(autopilot_type(), aircraft, frame);
  for (const char* name : {"frames", "state", "record"}) fs::create_directories(folder / name);

  BackgroundProgram camera(camera_call(nadir, inputs, autopilot.truth_endpoint(), folder / "frames"), folder);
  camera.wait_until_it_says("waiting for poses", kStart_s);
  const LonLat start = frame.lonlat_from_plane(aircraft.circuit().point(0));
  std::vector<std::string> words = nadird_call(nadird, inputs, autopilot.link_endpoint(), listen, folder, start);
  if (px4) words.push_back("--switch-gps");
  if (out_) words.push_back("--keep-frames");  // so that the recording is all that a replay needs
  for (const std::string& url : ground_stations_) words.insert(words.end(), {"--ground-station", url});
  BackgroundProgram service(words, folder);
  wait_for_page(page, service);
  if (!context.quiet) {
    const char* unit = minutes_ == 1 ? "minute" : "minutes";
    context.err << fmt::format("flying for {:g} {}; nadird's page: {}/\n", minutes_, unit, page);
  }
  const LoopFlightSetup setup{.duration_s = minutes_ * 60,
                              .circumstance = circumstance(circumstance_, minutes_ * 60),
                              .page = page,
                              .track = folder / "track.csv",
                              .check = [&] {
                                if (interrupt_requested()) return;
                                camera.must_be_running();
                                service.must_be_running();
                              }};
  LoopFigures figures = fly_loop(setup, aircraft, autopilot, frame, context);
  service.end();  // whole: its recording is complete
  camera.end();
  const nlohmann::json frames = nlohmann::json::parse(camera.output(), nullptr, false);
  if (frames.is_object()) {
    figures.frames = frames.value("frames", 0);
    figures.frames_late = frames.value("frames_late", 0);
  }
  return figures;
}

void SimulateLoopCommand::report(Context& context, const LoopFigures& figures, const std::string& page) const {
  const auto spread_json = [](const std::optional<Spread>& spread) -> nlohmann::json {
    if (!spread) return nullptr;
    return {{"median", rounded(spread->median)}, {"p95", rounded(spread->p95)}, {"worst", rounded(spread->worst)}};
  };
  const auto spread_text = [](const std::optional<Spread>& spread) -> std::string {
    if (!spread) return "none";
    return fmt::format("worst {:.1f} m, median {:.1f} m, 95 % within {:.1f} m", spread->worst, spread->median,
                       spread->p95);
  };
  if (context.json) {
    print_json(context.out, {{"autopilot", autopilot_},
                             {"circumstance", circumstance_},
                             {"folder", out_ ? nlohmann::json(out_->string()) : nlohmann::json()},
                             {"page", page + "/"},
                             {"flown_s", rounded(figures.flown_s)},
                             {"lap_m", rounded(figures.lap_m, 1)},
                             {"late_s", rounded(figures.late_s)},
                             {"frames", figures.frames},
                             {"frames_late", figures.frames_late},
                             {"fixes", figures.fixes},
                             {"fix_error_m", spread_json(figures.fix_error_m)},
                             {"off_track_m", spread_json(figures.off_track_m)},
                             {"flown_by_fixes_s", rounded(figures.by_fixes_s)},
                             {"usable_from_s", figures.usable_from_s ? nlohmann::json(rounded(*figures.usable_from_s))
                                                                     : nlohmann::json()},
                             {"not_usable_s", rounded(figures.unusable_s)}});
    return;
  }
  const std::string usable = figures.usable_from_s
                                 ? fmt::format("{:.1f} s, after the first usable position at {:.1f} s",
                                               figures.unusable_s, *figures.usable_from_s)
                                 : "all the time";
  Figures table{
      {"flown", fmt::format("{:.0f} s, laps of {:.0f} m, {:.0f} s of it by nadird's positions", figures.flown_s,
                            figures.lap_m, figures.by_fixes_s)},
      {"positions from the truth", fmt::format("{}; {} of them", spread_text(figures.fix_error_m), figures.fixes)},
      {"aircraft from its plan", spread_text(figures.off_track_m)},
      {"not usable", usable}};
  if (figures.late_s > 0 || figures.frames_late > 0) {
    table.emplace_back("machine too slow",
                       fmt::format("{} of {} frames later than nadird reckons with; up to {:.1f} s behind real time",
                                   figures.frames_late, figures.frames, figures.late_s));
  }
  if (out_) table.emplace_back("kept in", out_->string());
  print_figures(context.out, table);
}

}  // namespace

std::unique_ptr<Command> make_simulate_loop() { return std::make_unique<SimulateLoopCommand>(); }

}  // namespace nadir
