// Monte Carlo of misleading information: many short flights over synthetic worlds, each with one fault, and how often
// the localizer was wrong with confidence. docs/safety.md.
#include <fmt/format.h>

#include <algorithm>
#include <iostream>
#include <opencv2/core/utility.hpp>

#include "base/files.hpp"
#include "base/platform.hpp"
#include "safety_segment.hpp"
#include "second_matcher_options.hpp"
#include "seeded_runs.hpp"

using namespace nadir;
using namespace nadir::bench;

namespace {

int run(const RunOptions& options, SecondMatcherOptions second, FrameSpacing spacing,
        const std::vector<std::uint64_t>& only, bool verbose, const std::filesystem::path& plot) {
  cv::setNumThreads(1);
  keep_freed_memory();
  const Segments segments(only.empty() && options.count == 0 ? 0 : options.worlds,  // none only to print a table
                          options.seed, spacing, second.matcher());
  std::function<void(const std::string&)> talk;
  if (verbose) talk = [](const std::string& text) { std::cout << text << std::flush; };
  std::map<std::uint64_t, Record> records;
  for (const std::uint64_t index : only) records[index] = segments.run(options.seed, index, talk);
  if (only.empty()) {
    const std::string head = header(options.seed, options.worlds, spacing_name(spacing) + second.name());
    records = run_all<Record>(options, head, record_of, [&](std::uint64_t i) {
      std::string lines;  // of one segment together, whatever the other threads fly
      const Record record =
          segments.run(options.seed, i, verbose ? [&](const std::string& text) { lines += text; } : talk);
      std::cout << lines << std::flush;
      if (record.violates()) std::cout << fmt::format("VIOLATION {}", line(record)) << std::flush;
      return record;
    });
  }
  if (!plot.empty()) write_file_atomic(plot, stanford_svg("short flights under faults", all_levels(records)));
  std::cout << summary(records, options.seed) << "\n"
            << level_summary(records) << "\n"
            << motion_summary(records) << "\n"
            << fmt::format("{} segments, base seed {}, {} worlds{}{}\n", records.size(), options.seed, options.worlds,
                           spacing_name(spacing), second.name());
  return std::any_of(records.begin(), records.end(), [](const auto& r) { return r.second.violates(); }) ? 1 : 0;
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App app("Short simulated flights under faults: how often is the localizer wrong with confidence?", "safety");
  RunOptions options;
  options.count = 10'000;
  options.add_to(app, "segments");
  SecondMatcherOptions second;
  second.add_to(app);
  bool sparse = false;
  app.add_flag("--sparse", sparse, "frames that share at most 40 % of their ground, and mostly less");
  std::vector<std::uint64_t> only;
  app.add_option("--only", only, "run the segments of these indices alone");
  bool verbose = false;
  app.add_flag("--verbose", verbose, "a line for every frame");
  std::filesystem::path plot;
  app.add_option("--svg", plot, "draw the Stanford diagram into this file");
  CLI11_PARSE(app, argc, argv);
  try {
    return run(options, second, sparse ? FrameSpacing::sparse : FrameSpacing::usual, only, verbose, plot);
  } catch (const std::exception& error) {
    std::cerr << "safety: " << error.what() << "\n";
    return 2;
  }
}
