// Many independent trials, each of which follows from the base seed and its index: in any order, by several threads,
// kept in a file and resumed after a kill.
#pragma once

#include <CLI/CLI.hpp>
#include <algorithm>
#include <atomic>
#include <chrono>
#include <map>
#include <mutex>
#include <thread>
#include <vector>

#include "results_file.hpp"

namespace nadir::bench {

struct RunOptions {
  std::uint64_t count = 0, seed = 1;
  int threads = 1, worlds = 4;
  double minutes = 1e9;
  std::filesystem::path results;

  void add_to(CLI::App& app, const std::string& what) {
    app.add_option("--" + what, count, "how many in all")->capture_default_str();
    app.add_option("--seed", seed, "base seed: it and an index determine everything")->capture_default_str();
    app.add_option("--threads", threads, "number of threads; the results are the same")
        ->check(CLI::Range(1, 64))
        ->capture_default_str();
    app.add_option("--worlds", worlds, "generated in memory first, some seconds each")
        ->check(CLI::Range(2, 64))
        ->capture_default_str();
    app.add_option("--minutes", minutes, "start no trial after this time");
    app.add_option("--resume", results, "keep results in this CSV file and resume where it ends");
  }
};

// parse: a line of the file to a result. job: an index to a result. Results have .index and line(result).
// chosen: the indices; empty: the first so many.
template <typename Result, typename Parse, typename Job>
std::map<std::uint64_t, Result> run_all(const RunOptions& options, const std::string& header, Parse parse, Job job,
                                        const std::vector<std::uint64_t>& chosen = {}) {
  ResultsFile file(options.results, header);
  std::map<std::uint64_t, Result> results;
  for (const std::string& text : file.lines()) {
    const Result result = parse(text);
    results[result.index] = result;
  }
  const auto end = std::chrono::steady_clock::now() + std::chrono::duration<double>(60 * options.minutes);
  std::mutex mutex;
  std::atomic<std::uint64_t> next{0};
  const auto work = [&] {
    const std::uint64_t count = chosen.empty() ? options.count : std::min(options.count, chosen.size());
    for (std::uint64_t at = next++; at < count && std::chrono::steady_clock::now() < end; at = next++) {
      const std::uint64_t i = chosen.empty() ? at : chosen[at];
      {
        const std::lock_guard lock(mutex);
        if (results.contains(i)) continue;
      }
      const Result result = job(i);
      const std::lock_guard lock(mutex);
      results[i] = result;
      file.append(line(result));
    }
  };
  std::vector<std::jthread> threads;
  for (int i = 1; i < options.threads; ++i) threads.emplace_back(work);
  work();
  threads.clear();  // joins
  return results;
}

}  // namespace nadir::bench
