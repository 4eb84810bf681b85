// The contribution of each step of the method: a flight without the step, or with another backend.
//
//   ablations FRAMES TELEMETRY CAMERA TRUTH [PACKAGE ROOT.json AT]
#include <fmt/format.h>

#include <algorithm>
#include <cstdio>
#include <opencv2/core/utility.hpp>

#include "ablation_flight.hpp"
#include "base/platform.hpp"
#include "base/quantile.hpp"
#include "estimation/terrain_surface.hpp"
#include "flow_odometry.hpp"
#include "package/open_package.hpp"
#include "replay/flight_request.hpp"
#include "replay/score.hpp"

namespace nadir::bench {
namespace {

constexpr double kSearchRadius_m = 300;
constexpr std::size_t kSearchEvery = 3;  // frames

double percent(std::size_t part, std::size_t whole) {
  return whole == 0 ? 0 : 100 * static_cast<double>(part) / static_cast<double>(whole);
}

double mean(const std::vector<double>& values) {
  double sum = 0;
  for (const double value : values) sum += value;
  return values.empty() ? 0 : sum / static_cast<double>(values.size());
}

void print_flight(const std::string& name, const MatchingFigures& f) {
  const std::string errors = f.error_m.empty() ? "| |"
                                               : fmt::format("{:.1f} | {:.1f} | {:.1f}", quantile(f.error_m, 0.5),
                                                             mean(f.error_m), quantile(f.error_m, 0.95));
  fmt::print("| {} | {:.0f} | {} | {} | {:.0f} |\n", name, percent(f.anchored, f.frames), f.wrong, errors,
             mean(f.attempt_ms));
  std::fflush(stdout);
}

// Frames whose place was found, but awaited more looks: accepted at once.
void print_all_candidates(const std::string& name, const MatchingFigures& f) {
  fmt::print("| {} | {:.0f} | {} | | | | |\n", name, percent(f.anchored + f.awaiting, f.frames),
             f.wrong + f.awaiting_wrong);
}

void print_flights(const RecordedFlight& recorded, const FlownMap& map) {
  fmt::print(
      "\n| flown | anchored % | wrong | median m | mean m | p95 m | CPU ms an attempt "
      "|\n|---|---|---|---|---|---|---|\n");
  for (const Variant& variant : matcher_variants()) {
    const MatchingFigures figures = fly(recorded, map, variant.matcher, recorded.truth.front());
    print_flight(variant.name, figures);
    if (variant.name == "full") print_all_candidates("every candidate accepted", figures);
  }
  if (!map.config.area) return;
  const MatchingFigures lost = fly(recorded, map, make_channel_matcher, std::nullopt);
  print_flight("full, no start known", lost);
  print_all_candidates("the same, every candidate accepted", lost);
}

void print_searches(const RecordedFlight& recorded, const FlownMap& map) {
  fmt::print(
      "\n| each frame by itself, ±{:.0f} m, the best place | best place right % | median ratio | CPU ms "
      "|\n|---|---|---|---|\n",
      kSearchRadius_m);
  for (const Variant& variant : matcher_variants()) {
    if (variant.name == "image centre") continue;  // searches as the full one
    const SearchFigures f = search(recorded, map, variant.matcher, kSearchRadius_m, kSearchEvery);
    fmt::print("| {} | {:.0f} | {:.2f} | {:.0f} |\n", variant.name, percent(f.right, f.frames), quantile(f.ratio, 0.5),
               mean(f.attempt_ms));
    std::fflush(stdout);
  }
}

void print_drifts(const RecordedFlight& recorded) {
  fmt::print("\n| odometry alone | tracked % | drift % | CPU ms a step |\n|---|---|---|---|\n");
  for (const auto& [name, make] : {std::pair{"features", OdometryFactory(make_feature_odometry)},
                                   std::pair{"flow", OdometryFactory(make_flow_odometry)}}) {
    const DriftFigures f = drift(recorded, make);
    fmt::print("| {} | {:.0f} | {} | {:.0f} |\n", name, percent(f.tracked, f.frames - 1),
               f.drift_share ? fmt::format("{:.2f}", 100 * *f.drift_share) : "no segment of five frames",
               mean(f.step_ms));
  }
}

int run(const std::vector<std::string>& arguments) {
  cv::setNumThreads(1);
  keep_freed_memory();
  const RecordedFlight recorded = recorded_flight({arguments[0], arguments[1], arguments[2]}, arguments[3]);
  fmt::print("{} frames\n", recorded.pictures.size());
  print_drifts(recorded);
  if (arguments.size() == 4) return 0;
  NoProgress progress;
  const Opening opening =
      open_flight_map({arguments[4], arguments[5], std::nullopt}, parse_utc(arguments[6]).value(), progress);
  if (!opening.package) return std::fputs("ablations: the package is rejected\n", stderr), 1;
  const OpenPackage& package = *opening.package;
  FlownMap map{package.imagery(), mission_frame(package.mission()), {}};
  map.config.map_sigma_m = map_sigma_m(package.imagery());
  map.config.area = required_region(package.mission(), map.frame).bounds();
  std::optional<TerrainSurface> surface;
  if (package.terrain() != nullptr) {
    map.config.surface = &surface.emplace(*package.terrain(), map.frame, package.mission().terrain.height_m);
  }
  print_flights(recorded, map);
  print_searches(recorded, map);
  return 0;
}

}  // namespace
}  // namespace nadir::bench

int main(int argc, char** argv) {
  if (argc != 5 && argc != 8) {
    return std::fputs("usage: ablations FRAMES TELEMETRY CAMERA TRUTH [PACKAGE ROOT.json AT]\n", stderr), 2;
  }
  try {
    return nadir::bench::run({argv + 1, argv + argc});
  } catch (const std::exception& error) {
    return std::fprintf(stderr, "ablations: %s\n", error.what()), 2;
  }
}
