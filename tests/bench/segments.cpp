// Floating segments placed as wholes, over drawn lands: how many are placed, how many wrongly, how far off, and what a
// step costs. The map shows the land of today, half of it as it was, most of it as it was, or does not show it at all.
//
// Usage: bench_segments [SEEDS [FIRST [ROWS]]]    20 seeds from 1 on; only the first rows of the table
#include <fmt/format.h>

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <ctime>
#include <span>
#include <vector>

#include "estimation/map_look.hpp"
#include "flights/segment_world.hpp"
#include "geodesy/angles.hpp"

using namespace nadir;
using namespace nadir::test;

namespace {

constexpr double kChi2Of2_95 = 5.991;
constexpr double kWrong_m = 20;  // farther off than this a placed frame is placed wrongly

struct Tally {
  int segments = 0, placed = 0, wrong = 0, frames = 0;
  int within = 0;  // frames inside of their 95 % ellipse
  double nees = 0, longest_step_s = 0, cpu_s = 0;
  std::vector<double> errors_m;
};

void add(Tally& tally, const WorldOptions& world_options, const SegmentWorld& world,
         const SegmentWorld::Segment& segment, MapHole hole) {
  ++tally.segments;
  const auto tiles = world.map(hole, segment);
  const FlatGround flat;
  const auto matcher = make_channel_matcher({world.camera().camera, *tiles, world.frame(), flat});
  SegmentPlacement placement(segment.shape,
                             {.camera = world.camera(),
                              .matcher = *matcher,
                              .area = world.area(),
                              .places = nullptr,
                              .read = [&](std::size_t frame) { return segment.images[frame]; }},
                             {}, {});
  for (bool more = true; more;) {
    const std::clock_t begun = std::clock();
    more = placement.step();
    const double step_s = static_cast<double>(std::clock() - begun) / CLOCKS_PER_SEC;
    tally.longest_step_s = std::max(tally.longest_step_s, step_s);
    tally.cpu_s += step_s;
  }
  const SegmentPlacementResult result = placement.result();
  if (result.poses.empty()) return;
  ++tally.placed;
  bool wrong = false;
  for (std::size_t i = 0; i < result.poses.size(); ++i) {
    const Eigen::Vector2d off_m = result.poses[i].position - segment.truth[i].position;
    Eigen::Matrix2d covariance_m2 = result.poses[i].covariance_m2;
    // The allowance for what all looks share is published too. Land that is drawn flat has nothing of the kind.
    if (world_options.relief_m > 0) {
      covariance_m2 += unmodelled_variance_m2(segment.shape.frames[i].agl_m) * Eigen::Matrix2d::Identity();
    }
    const double squared = off_m.dot(covariance_m2.inverse() * off_m);
    tally.nees += squared / 2;
    tally.within += squared <= kChi2Of2_95 ? 1 : 0;
    ++tally.frames;
    tally.errors_m.push_back(off_m.norm());
    wrong = wrong || off_m.norm() > kWrong_m;
  }
  tally.wrong += wrong ? 1 : 0;
}

void print(const char* what, Tally tally) {
  double median_m = 0, worst_m = 0;
  if (!tally.errors_m.empty()) {
    std::sort(tally.errors_m.begin(), tally.errors_m.end());
    median_m = tally.errors_m[tally.errors_m.size() / 2], worst_m = tally.errors_m.back();
  }
  fmt::print("| {:<44} | {:>3} | {:>3} | {:>3} | {:>5.1f} | {:>5.1f} | {:>5.2f} | {:>5.1f} | {:>4.1f} | {:>4.1f} |\n",
             what, tally.segments, tally.placed, tally.wrong, median_m, worst_m, tally.nees / std::max(1, tally.frames),
             100.0 * tally.within / std::max(1, tally.frames), tally.cpu_s / std::max(1, tally.segments),
             tally.longest_step_s);
  std::fflush(stdout);
}

}  // namespace

int main(int argc, char** argv) {
  const int seeds = argc > 1 ? std::atoi(argv[1]) : 20, first = argc > 2 ? std::atoi(argv[2]) : 1;
  const std::size_t most_rows = argc > 3 ? static_cast<std::size_t>(std::atoi(argv[3])) : SIZE_MAX;
  struct Row {
    const char* what;
    WorldOptions world;
    bool heading;
    MapHole hole;
  };
  const std::vector<Row> rows{
      {"map of today", {.half_side_m = 420}, true, MapHole::none},
      {"half of the land has changed", {.half_side_m = 420, .changed_share = 0.5}, true, MapHole::none},
      {"the same, noise of 12 grey levels",
       {.half_side_m = 420, .changed_share = 0.5, .noise = 12},
       true,
       MapHole::none},
      {"three quarters have changed", {.half_side_m = 420, .changed_share = 0.75}, true, MapHole::none},
      {"half has changed, tilt as badly known as stated",
       {.half_side_m = 420, .changed_share = 0.5, .tilt_sigma_rad = radians(1)},
       true,
       MapHole::none},
      {"the same, and relief of 0.85 m",
       {.half_side_m = 420, .changed_share = 0.5, .relief_m = 0.85, .tilt_sigma_rad = radians(1)},
       true,
       MapHole::none},
      {"half has changed, no heading", {.half_side_m = 420, .changed_share = 0.5}, false, MapHole::none},
      {"the segment's ground is cut out of the map", {.half_side_m = 420, .changed_share = 0.5}, true, MapHole::blank},
      {"the same, no heading", {.half_side_m = 420, .changed_share = 0.5}, false, MapHole::blank},
      {"a map of another land", {.half_side_m = 420}, true, MapHole::other_land}};
  fmt::print("{} seeds; eight frames, 25 m apart, 100 m above the land; area 640 x 640 m\n\n", seeds);
  fmt::print("| {:<44} | {} | {} | {} | {} | {} | {} | {} | {} | {} |\n", "", "segments", "placed", "wrong", "median m",
             "worst m", "NEES / 2", "% in 95 %", "CPU s", "longest step s");
  fmt::print("|---|---|---|---|---|---|---|---|---|---|\n");
  int wrong = 0;
  for (const Row& row : std::span(rows).first(std::min(most_rows, rows.size()))) {
    Tally tally;
    for (int seed = first; seed < first + seeds; ++seed) {
      const SegmentWorld world(static_cast<std::uint64_t>(100 + seed), row.world);
      add(tally, row.world, world, world.segment(seed, 8, row.heading), row.hole);
    }
    wrong += tally.wrong;
    print(row.what, tally);
  }
  return wrong == 0 ? 0 : 1;
}
