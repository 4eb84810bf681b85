// Errors of the tiles that flights make: short simulated flights, half of them with a
// fault; docs/benchmarks.md has the bars.
#include <fmt/format.h>

#include <algorithm>
#include <iostream>
#include <opencv2/core/utility.hpp>

#include "geodesy/web_mercator.hpp"
#include "seeded_runs.hpp"
#include "tile_trial.hpp"

using namespace nadir;
using namespace nadir::bench;

namespace {

constexpr double kFar_m = 30, kVeryFar_m = 100;

double median(std::vector<double> values) {
  if (values.empty()) return 0;
  std::nth_element(values.begin(), values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2), values.end());
  return values[values.size() / 2];
}

struct Sum {
  std::size_t flights = 0, with_tiles = 0, unrecognised = 0, far = 0, very_far = 0;
  std::vector<double> geometric, raster, pose;

  void add(const TileTrial& trial, bool refined) {
    ++flights;
    const std::size_t before = geometric.size();
    for (const TileOff& tile : trial.tiles) {
      if (tile.refined != refined) continue;
      geometric.push_back(tile.geometric_m);
      pose.push_back(tile.pose_error_m);
      tile.raster_m < 0 ? void(++unrecognised) : raster.push_back(tile.raster_m);
      far += tile.geometric_m > kFar_m;
      very_far += tile.geometric_m > kVeryFar_m;
    }
    with_tiles += geometric.size() > before;
  }
  void print(const std::string& name) const {
    fmt::print("| {} | {} | {} | {} | {:.2f} | {:.2f} | {:.2f} | {} | {} | {} |\n", name, flights, with_tiles,
               geometric.size(), median(geometric), median(raster), median(pose), far, very_far, unrecognised);
  }
};

// A displaced map displaces its tiles as well, which no flight can detect.
bool wrong_map(const std::string& condition) {
  return condition.find("map") != std::string::npos || condition.find("region") != std::string::npos ||
         condition.starts_with("part ");
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App app("Errors of tiles made from simulated flights.", "tiles");
  RunOptions options;
  options.count = 200;
  options.add_to(app, "flights");
  CLI11_PARSE(app, argc, argv);
  try {
    cv::setNumThreads(1);
    const TileTrials trials(options.worlds);
    const auto results = run_all<TileTrial>(options, tile_trial_header(options.seed, options.worlds), tile_trial_of,
                                            [&](std::uint64_t i) { return trials.fly(options.seed, i); });
    fmt::print("seed {}, {} flights, {} worlds; tiles of {:.2f} m a pixel\n\n", options.seed, results.size(),
               options.worlds, ground_resolution_m(kTileTrialZoom, frame().origin().lat_deg));
    fmt::print(
        "| | flights | with tiles | tiles | median off, by the true pose m | by the raster m | median pose error m | "
        "> 30 m | > 100 m | too plain for the raster |\n|---|---|---|---|---|---|---|---|---|---|\n");
    bool met = true;
    for (const bool refined : {false, true}) {
      Sum right, wrong;
      for (const auto& [index, trial] : results) (wrong_map(trial.condition) ? wrong : right).add(trial, refined);
      right.print(refined ? "afterwards, map in its place" : "in flight, map in its place");
      wrong.print(refined ? "afterwards, map wrong" : "in flight, map wrong");
      const auto count = static_cast<double>(right.geometric.size());
      met = met && static_cast<double>(right.far) < 0.01 * count && static_cast<double>(right.very_far) < 0.001 * count;
    }
    std::map<std::string, Sum> by_condition;
    for (const auto& [index, trial] : results) by_condition[trial.condition].add(trial, true);
    fmt::print("\nafterwards, by condition:\n");
    for (const auto& [name, sum] : by_condition) sum.print(name);
    return met ? 0 : 1;
  } catch (const std::exception& error) {
    std::cerr << "tiles: " << error.what() << "\n";
    return 2;
  }
}
