// Long flights with turns, outliers, blackouts, wrong height and heading: errors, consistency, and whether every loss
// is recovered. docs/benchmarks.md.
#include <fmt/format.h>

#include <algorithm>
#include <iostream>
#include <opencv2/core/utility.hpp>

#include "base/files.hpp"
#include "base/platform.hpp"
#include "long_flight.hpp"
#include "second_matcher_options.hpp"
#include "seeded_runs.hpp"

using namespace nadir;
using namespace nadir::bench;

namespace {

int run(const RunOptions& options, SecondMatcherOptions second, int frames, const std::vector<std::uint64_t>& only,
        bool verbose, const std::filesystem::path& plot) {
  cv::setNumThreads(1);
  keep_freed_memory();
  const LongFlights flights(only.empty() && options.count == 0 ? 0 : options.worlds, frames, options.seed,
                            second.matcher());
  std::function<void(const std::string&)> talk;
  if (verbose) talk = [](const std::string& text) { std::cout << text << std::flush; };
  std::map<std::uint64_t, LongRecord> records;
  for (const std::uint64_t index : only) records[index] = flights.run(options.seed, index, talk);
  if (only.empty()) {
    records = run_all<LongRecord>(options, long_header(options.seed, options.worlds, frames, second.name()),
                                  long_record_of, [&](std::uint64_t i) { return flights.run(options.seed, i, talk); });
  }
  const std::map<std::uint64_t, Record> common(records.begin(), records.end());
  if (!plot.empty()) write_file_atomic(plot, stanford_svg("long flights", all_levels(common)));
  std::cout << long_summary(records) << "\n"
            << level_summary(common) << "\n"
            << fmt::format("{} flights of {} frames, base seed {}, {} worlds{}\n", records.size(), frames, options.seed,
                           options.worlds, second.name());
  return std::any_of(records.begin(), records.end(), [](const auto& r) { return r.second.violates(); }) ? 1 : 0;
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App app("Long simulated flights with turns and faults: accurate, consistent, and recovered after every loss?",
               "flights");
  RunOptions options;
  options.count = 2 * long_conditions().size();
  options.worlds = 2;
  options.add_to(app, "flights");
  SecondMatcherOptions second;
  second.add_to(app);
  int frames = 300;
  app.add_option("--frames", frames, "of each flight")->check(CLI::Range(30, 300))->capture_default_str();
  std::vector<std::uint64_t> only;
  app.add_option("--only", only, "run the flights of these indices alone");
  bool verbose = false;
  app.add_flag("--verbose", verbose, "a line for every frame");
  std::filesystem::path plot;
  app.add_option("--svg", plot, "draw the Stanford diagram into this file");
  CLI11_PARSE(app, argc, argv);
  try {
    return run(options, second, frames, only, verbose, plot);
  } catch (const std::exception& error) {
    std::cerr << "flights: " << error.what() << "\n";
    return 2;
  }
}
