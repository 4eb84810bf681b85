// The flight log smoothed in two ways: our filter run back and forth with anchors switched off one by one, and a batch
// in Ceres with a robust loss. docs/benchmarks.md.
#include <fmt/format.h>
#include <sys/resource.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <ctime>
#include <iostream>

#include "batch_graph.hpp"

using namespace nadir;
using namespace nadir::bench;
using namespace nadir::test;

namespace {

struct Case {
  const char* name;
  DrawnOptions options;
};

std::vector<Case> cases() {
  std::vector<Case> all(6);
  all[0].name = "anchor every 10 frames";
  all[1].name = "segments: 20 of 50 frames blind", all[1].options.blind_every = 30;
  all[2].name = "the same, height to 15 %", all[2].options.blind_every = 30;
  all[2].options.uncertainty.agl_relative = 0.15;
  all[3].name = "3 % wrong anchors", all[3].options.wrong_anchor_share = 0.03;
  all[4].name = "10 % wrong anchors", all[4].options.wrong_anchor_share = 0.1;
  all[5].name = "segments, height to 15 %, 10 % wrong", all[5].options = all[2].options;
  all[5].options.wrong_anchor_share = 0.1;
  return all;
}

struct Score {
  std::vector<double> errors_m;
  int in_95 = 0;
  double seconds = 0, covariance_s = 0;

  void add(const std::vector<FlightFilter::Smoothed>& frames, const DrawnFlight& flight) {
    for (std::size_t i = 0; i < frames.size(); ++i) {
      const Eigen::Vector2d error = frames[i].position.vector() - flight.frames[i].truth_m;
      errors_m.push_back(error.norm());
      in_95 += normalised_error(error, frames[i].covariance_m2) <= 5.991;
    }
  }
  std::string row(const std::string& name, bool covariances) {
    std::sort(errors_m.begin(), errors_m.end());
    const auto at = [&](double share) {
      return errors_m[static_cast<std::size_t>(share * (double(errors_m.size()) - 1))];
    };
    return fmt::format("| {} | {:.2f} | {:.2f} | {:.1f} | {} | {:.3f} | {} |\n", name, at(0.5), at(0.95), at(1),
                       covariances ? fmt::format("{:.1f}", 100.0 * in_95 / double(errors_m.size())) : "-", seconds,
                       covariances ? fmt::format("{:.2f}", covariance_s) : "-");
  }
};

double cpu_s() { return static_cast<double>(std::clock()) / CLOCKS_PER_SEC; }

}  // namespace

int main(int argc, char** argv) {
  CLI::App app("A flight log smoothed by the filter and by a batch in Ceres.", "smoothing");
  int frames = 300, flights = 10;
  std::uint64_t seed = 1;
  bool covariances = true;
  app.add_option("--frames", frames, "of each flight")->check(CLI::Range(20, 100000))->capture_default_str();
  app.add_option("--flights", flights, "of each kind")->check(CLI::Range(1, 100000))->capture_default_str();
  app.add_option("--seed", seed, "determines everything")->capture_default_str();
  app.add_flag("!--no-covariances", covariances, "leave the batch's covariances out");
  CLI11_PARSE(app, argc, argv);
  std::cout
      << fmt::format("{} flights of {} frames of each kind, seed {}; CPU seconds are for one flight\n\n", flights,
                     frames, seed)
      << "| | median m | p95 m | worst m | in 95 % | CPU s | of covariances, CPU s |\n|---|---|---|---|---|---|---|\n";
  for (const Case& c : cases()) {
    Score ours, batch;
    DrawnOptions options = c.options;
    options.frames = frames;
    for (int i = 0; i < flights; ++i) {
      const DrawnFlight flight = draw_flight(Random(seed).fork("flight", static_cast<std::uint64_t>(i)), options);
      const double began = cpu_s();
      const SmoothedFlight smoothed = smooth_flight(flight.fresh, flight.steps);
      ours.seconds += (cpu_s() - began) / flights;
      ours.add(smoothed.frames, flight);
      const BatchGraph graph = solve_batch(flight, options.uncertainty, covariances);
      batch.seconds += graph.solve_s / flights;
      batch.covariance_s += graph.covariance_s / flights;
      batch.add(graph.frames, flight);
    }
    std::cout << ours.row(std::string(c.name) + ": filter and smoother", true)
              << batch.row(std::string(c.name) + ": Ceres", covariances) << std::flush;
  }
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
  std::cout << fmt::format("\npeak memory {} MB\n", usage.ru_maxrss / 1024);
  return 0;
}
