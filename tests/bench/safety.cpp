// Monte Carlo of misleading information: many short flights over made-up worlds, each under one fault, and how often
// the localizer said something false with confidence. docs/safety.md.
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <atomic>
#include <chrono>
#include <fstream>
#include <iostream>
#include <mutex>
#include <opencv2/core/utility.hpp>
#include <thread>

#include "base/error.hpp"
#include "base/files.hpp"
#include "safety_segment.hpp"

using namespace nadir;
using namespace nadir::bench;

namespace {

struct Options {
  std::uint64_t segments = 10'000, seed = 1;
  int threads = 1, worlds = 4;
  double minutes = 1e9;
  std::filesystem::path results;
  std::optional<std::uint64_t> only;
  bool verbose = false;
};

// Begins the file, or cuts off what a killed run left unfinished.
std::map<std::uint64_t, Record> resume(const Options& options) {
  if (options.results.empty()) return {};
  if (!std::filesystem::exists(options.results)) {
    write_file_atomic(options.results, header(options.seed));
    return {};
  }
  const auto records = read_records(options.results, options.seed);
  const std::string text = read_text_file(options.results);
  if (!text.ends_with('\n')) write_file_atomic(options.results, text.substr(0, text.rfind('\n') + 1));
  return records;
}

int run(const Options& options) {
  cv::setNumThreads(1);
  const Segments segments(options.worlds);
  std::function<void(const std::string&)> talk;
  if (options.verbose) talk = [](const std::string& text) { std::cout << text << std::flush; };
  if (options.only) {
    const Record record = segments.run(options.seed, *options.only, talk);
    std::cout << summary({{record.index, record}}, options.seed);
    return record.violates() ? 1 : 0;
  }
  auto records = resume(options);
  std::ofstream out;
  if (!options.results.empty()) out.open(options.results, std::ios::app);
  const auto end = std::chrono::steady_clock::now() + std::chrono::duration<double>(60 * options.minutes);
  std::mutex mutex;
  std::atomic<std::uint64_t> next{0};
  const auto work = [&] {
    for (std::uint64_t i = next++; i < options.segments && std::chrono::steady_clock::now() < end; i = next++) {
      {
        const std::lock_guard lock(mutex);
        if (records.contains(i)) continue;
      }
      const Record record = segments.run(options.seed, i, talk);
      const std::lock_guard lock(mutex);
      records[i] = record;
      out << line(record) << std::flush;
      if (record.violates()) std::cout << line(record) << std::flush;
    }
  };
  {
    std::vector<std::jthread> threads;
    for (int i = 1; i < options.threads; ++i) threads.emplace_back(work);
    work();
  }
  std::cout << summary(records, options.seed);
  std::cout << fmt::format("{} of {} segments, base seed {}, {} worlds\n", records.size(), options.segments,
                           options.seed, options.worlds);
  for (const auto& [index, record] : records) {
    if (record.violates()) return 1;
  }
  return 0;
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App app("Short simulated flights under faults: how often is the localizer wrong with confidence?", "safety");
  Options options;
  app.add_option("--segments", options.segments, "how many in all (10000)");
  app.add_option("--seed", options.seed, "base seed: segment I follows from it and I (1)");
  app.add_option("--threads", options.threads, "segments at a time (1); the results are the same")
      ->check(CLI::Range(1, 64));
  app.add_option("--worlds", options.worlds, "made in memory first, some seconds each (4)")->check(CLI::Range(2, 64));
  app.add_option("--minutes", options.minutes, "begin no segment after so long");
  app.add_option("--resume", options.results, "keep results in this CSV file and go on where it ends");
  app.add_option("--only", options.only, "run this segment alone");
  app.add_flag("--verbose", options.verbose, "a line for every frame");
  CLI11_PARSE(app, argc, argv);
  try {
    return run(options);
  } catch (const std::exception& error) {
    std::cerr << "safety: " << error.what() << "\n";
    return 2;
  }
}
