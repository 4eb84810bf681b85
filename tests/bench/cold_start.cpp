// What it costs to find a frame in all of a mission's area, and whether it is found: each frame by a localizer that
// knows nothing but the area, with the package's place index and without, with the heading measured and unknown.
//
//   cold_start PACKAGE ROOT.json AT FRAMES TELEMETRY CAMERA TRUTH WAY…
//   WAY: index, index-any, all, all-any, hint, far-hint (-any: no heading is measured)
#include <cmath>
#include <cstdio>
#include <map>

#include "base/platform.hpp"
#include "circumstances.hpp"
#include "cpu_time.hpp"
#include "estimation/localizer.hpp"
#include "estimation/terrain_surface.hpp"
#include "replay/flight_folder.hpp"
#include "replay/flight_request.hpp"
#include "replay/score.hpp"
#include "vision/camera_frame.hpp"
#include "vision/place_index.hpp"

namespace nadir {
namespace {

using bench::cpu_ms;

constexpr double kWrong_m = 50;
constexpr double kHintRadius_m = 500, kHintOff_m = 300, kFarHintOff_m = 2500;

struct Way {
  bool index = false, heading = true;
  double hint_off_m = 0;  // 0: none
};
const std::map<std::string, Way> kWays{{"index", {true, true, 0}},          {"index-any", {true, false, 0}},
                                       {"all", {false, true, 0}},           {"all-any", {false, false, 0}},
                                       {"hint", {false, true, kHintOff_m}}, {"far-hint", {true, true, kFarHintOff_m}}};

struct Tally {
  std::vector<double> ms;
  std::map<std::string_view, int> verdicts;
  int wrong = 0;
  double ratios = 0;

  void print(const std::string& way) {
    const Spread s = spread_of(ms);
    fmt::print("{:<10} {:>6} {:>9.0f} {:>9.0f} {:>9.0f} {:>9} {:>6} {:>11.2f}  ", way, ms.size(), s.mean, s.p50,
               s.largest, verdicts["accepted"], wrong, ratios / static_cast<double>(ms.size()));
    for (const auto& [verdict, count] : verdicts) fmt::print("{} {}  ", verdict, count);
    fmt::print("\n");
    std::fflush(stdout);
  }
};

}  // namespace

int run(const std::vector<std::string>& arguments) {
  const Flight flight = read_flight({arguments[3], arguments[4], arguments[5]});
  const Truth truth = read_truth(arguments[6], flight.frames);
  NoProgress progress;
  const Opening opening =
      open_flight_map({arguments[0], arguments[1], std::nullopt}, parse_utc(arguments[2]).value(), progress);
  if (!opening.package) return std::fputs("cold_start: the package is rejected\n", stderr), 1;
  const OpenPackage& package = *opening.package;
  const LocalFrame frame = mission_frame(package.mission());
  const auto index = PlaceIndex::open(package.folder(), package.manifest());
  std::optional<TerrainSurface> surface;
  LocalizerConfig config;
  config.area = required_region(package.mission(), frame).bounds();
  config.map_sigma_m = map_sigma_m(package.imagery());
  if (package.terrain() != nullptr) {
    config.surface = &surface.emplace(*package.terrain(), frame, package.mission().terrain.height_m);
  }
  const int shrink = decode_reduction(flight.camera.camera.width, flight.camera.camera.height);
  CameraFile camera = flight.camera;
  camera.camera = camera.camera.scaled(1.0 / shrink);
  fmt::print("cold start over {:.1f} km², CPU ms of the first frame\n",
             (config.area->east_m - config.area->west_m) * (config.area->north_m - config.area->south_m) / 1e6);
  fmt::print("{:<10} {:>6} {:>9} {:>9} {:>9} {:>9} {:>6} {:>11}\n", "", "frames", "mean", "p50", "largest", "accepted",
             "wrong", "mean ratio");
  for (std::size_t w = 7; w < arguments.size(); ++w) {
    const Way& way = kWays.at(arguments[w]);
    config.places = way.index && index ? &*index : nullptr;
    Tally tally;
    for (std::size_t i = 0; i < flight.frames.size(); ++i) {
      if (!truth[i]) continue;
      Telemetry telemetry = flight.frames[i];
      if (!way.heading) telemetry.heading_rad = std::nullopt;
      const cv::Mat picture = read_grey_image(flight.frames_folder / telemetry.frame, shrink);
      const PlanePoint there = frame.plane_from_lonlat(*truth[i]);
      Localizer localizer(camera, frame, &package.imagery(), std::nullopt, config);
      if (way.hint_off_m > 0) {
        localizer.hint(
            frame.lonlat_from_plane({there.east_m + 0.8 * way.hint_off_m, there.north_m - 0.6 * way.hint_off_m}),
            kHintRadius_m);
      }
      const double before = cpu_ms();
      const FrameReport report = localizer.process(picture, telemetry);
      tally.ms.push_back(cpu_ms() - before);
      ++tally.verdicts[name_of(report.anchor.verdict)];
      tally.ratios += report.anchor.ratio;
      if (report.anchor.verdict != AnchorVerdict::accepted) continue;
      const PlanePoint at = frame.plane_from_lonlat(*report.estimate.position);
      tally.wrong += distance_m(at, there) > kWrong_m;
    }
    tally.print(arguments[w]);
  }
  fmt::print("{}\n", circumstances());
  return 0;
}

}  // namespace nadir

int main(int argc, char** argv) {
  nadir::keep_freed_memory();  // as nadird does
  if (argc < 9) {
    return std::fputs("usage: cold_start PACKAGE ROOT.json AT FRAMES TELEMETRY CAMERA TRUTH WAY...\n", stderr), 2;
  }
  try {
    return nadir::run({argv + 1, argv + argc});
  } catch (const std::exception& error) {
    return std::fprintf(stderr, "cold_start: %s\n", error.what()), 2;
  }
}
