#include "commands/simulate/loop_inputs.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <array>
#include <deque>
#include <ostream>
#include <string>

#include "base/error.hpp"
#include "cli/terminal.hpp"
#include "planning/child_program.hpp"
#include "provision/airframe_manifest.hpp"
#include "trust/keys.hpp"
#include "vision/camera.hpp"

namespace nadir {
namespace {

namespace fs = std::filesystem;

constexpr std::size_t kKeptErrorLines = 12;
constexpr const char* kExpires = "2035-01-01";

// Corners as shares of the sector's box, east and north: turns of 20° to 110°, left and right.
constexpr std::array<std::array<double, 2>, 6> kCircuit{
    {{0.20, 0.20}, {0.80, 0.22}, {0.78, 0.50}, {0.50, 0.60}, {0.75, 0.82}, {0.22, 0.80}}};

class Maker {
 public:
  Maker(const fs::path& nadir, const fs::path& folder, Context& context)
      : nadir_(nadir), folder_(folder), context_(context) {}

  void announce(const std::string& what) const {
    if (!context_.quiet) context_.err << what << " …" << std::endl;
  }

  void make(std::vector<std::string> words) const {
    words.insert(words.begin(), nadir_.string());
    std::deque<std::string> said;
    const auto keep = [&said](std::string_view line) {
      said.emplace_back(line);
      if (said.size() > kKeptErrorLines) said.pop_front();
    };
    const ProgramResult result = run_program_call({.words = words, .folder = folder_}, keep, interrupt_requested);
    throw_if_interrupted();
    if (result.exit_code == kAccepted) return;
    throw Error({.what = "a command failed",
                 .where = fmt::format("{}", fmt::join(words, " ")),
                 .found = fmt::format("exit code {}: {}", result.exit_code, fmt::join(said, " "))});
  }

 private:
  fs::path nadir_, folder_;
  Context& context_;
};

std::vector<LonLat> circuit_in(const Mission& mission) {
  if (mission.sectors.empty()) {
    throw UsageError({.what = "the mission has no sector to fly in", .where = "mission.yaml of the world"});
  }
  const std::vector<LonLat>& ring = mission.sectors.front().polygon;
  const auto [west, east] = std::ranges::minmax(ring, {}, &LonLat::lon_deg);
  const auto [south, north] = std::ranges::minmax(ring, {}, &LonLat::lat_deg);
  std::vector<LonLat> corners;
  for (const auto& [x, y] : kCircuit) {
    corners.push_back(
        {west.lon_deg + x * (east.lon_deg - west.lon_deg), south.lat_deg + y * (north.lat_deg - south.lat_deg)});
  }
  return corners;
}

void write_loop_airframe(const fs::path& folder, const fs::path& camera,
                         const std::vector<AirframeParameter>& parameters, const fs::path& key) {
  Airframe airframe;
  airframe.id = "simulated";
  airframe.camera = read_camera_file(camera);
  airframe.capture_delay_s = kLoopCaptureDelay_s;
  airframe.sequence = 1;
  airframe.expires = parse_utc(kExpires);
  airframe.parameters = parameters;
  write_airframe(folder, airframe, PrivateKey::read(key));
}

}  // namespace

LoopInputs make_loop_inputs(const fs::path& nadir, const std::optional<fs::path>& world,
                            const std::vector<AirframeParameter>& parameters, const fs::path& folder,
                            Context& context) {
  const Maker maker(nadir, folder, context);
  const auto in_folder = [&](const char* name) { return (folder / name).string(); };
  LoopInputs inputs{.world = world ? fs::absolute(*world) : folder / "world",
                    .package = folder / "package",
                    .trust = folder / "root.json",
                    .airframe = folder / "airframe" / "airframe.json",
                    .mission = {},
                    .circuit = {}};
  if (!world) {
    maker.announce("making a landscape of 2 × 2 km");
    maker.make(
        {"simulate", "world", "--seed", "7", "--size-km", "2", "--gsd-m", "0.4", "--out", inputs.world.string()});
  }
  const auto in_world = [&](const char* name) { return (inputs.world / name).string(); };
  inputs.mission = read_mission(in_world("mission.yaml"));
  inputs.altitude_m = inputs.mission.terrain.height_m + inputs.mission.route.agl_m;
  inputs.circuit = circuit_in(inputs.mission);

  maker.announce("making its signed map package");
  for (const char* name : {"root", "signer", "hangar"}) maker.make({"keys", "create", "--out", in_folder(name)});
  maker.make({"keys", "root", "--root-key", in_folder("root.key.pem"), "--package-signer", in_folder("signer.pub.pem"),
              "--airframe-signer", in_folder("hangar.pub.pem"), "--expires", kExpires, "--out", inputs.trust.string()});
  maker.make({"cache", "build", "--mission", in_world("mission.yaml"), "--imagery", in_world("map.tif"), "--dem",
              in_world("dem.tif"), "--key", in_folder("signer.key.pem"), "--out", inputs.package.string()});
  maker.make({"cache", "index", inputs.package.string(), "--key", in_folder("signer.key.pem")});
  write_loop_airframe(inputs.airframe.parent_path(), in_world("camera.yaml"), parameters, in_folder("hangar.key.pem"));
  return inputs;
}

}  // namespace nadir
