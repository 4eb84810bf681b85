// The cost of checking a package's sidecars: coverage by area, and freshness at a time when every tile must be looked
// up.
//
//   check_tile_requirements PACKAGE
#include <fmt/format.h>

#include <chrono>
#include <cstdio>
#include <exception>

#include "package/manifest.hpp"
#include "package/mission_check.hpp"
#include "package/sidecar.hpp"
#include "package/tile_container.hpp"

namespace nadir {
namespace {

double seconds(auto&& work) {
  const auto begun = std::chrono::steady_clock::now();
  work();
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - begun).count();
}

}  // namespace

void run(const std::filesystem::path& package) {
  const Mission mission = read_mission(package / kMissionFile);
  SidecarRows rows;
  Findings gaps, stale;
  const double reading_s = seconds([&] {
    const auto container = open_tile_container(package / kImageryFile);
    rows = read_sidecars(*container->sidecars());
  });
  const double coverage_s = seconds([&] { gaps = check_coverage(mission, rows.sidecars); });
  const UtcTime later{mission.created.unix_s + 10 * 365 * 86'400LL};
  const double freshness_s = seconds([&] { stale = check_freshness(mission, rows.sidecars, later); });
  fmt::print("{} tiles: sidecars read in {:.2f} s; coverage {:.2f} s ({} findings); freshness {:.2f} s ({} findings)\n",
             rows.sidecars.size(), reading_s, coverage_s, gaps.items().size(), freshness_s, stale.items().size());
}

}  // namespace nadir

int main(int argc, char** argv) {
  if (argc != 2) return std::fputs("usage: judge_tiles PACKAGE\n", stderr), 2;
  try {
    nadir::run(argv[1]);
  } catch (const std::exception& error) {
    return std::fprintf(stderr, "judge_tiles: %s\n", error.what()), 2;
  }
  return 0;
}
