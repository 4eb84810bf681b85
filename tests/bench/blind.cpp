// The camera goes blind: how far off the flight filter is after a while, with an inertial sensor and without, and
// whether it knows. docs/benchmarks.md.
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <iostream>

#include "estimation/blind_flight.hpp"
#include "estimation/consistency.hpp"

using namespace nadir;
using namespace nadir::test;

namespace {

struct Row {
  std::vector<double> errors_m, sigmas_m;
  Tally nees;

  double error_m(double share) {
    std::ranges::sort(errors_m);
    return errors_m[static_cast<std::size_t>(share * static_cast<double>(errors_m.size() - 1))];
  }
  double sigma_m() {
    std::ranges::sort(sigmas_m);
    return sigmas_m[sigmas_m.size() / 2];
  }
};

std::string cells(Row& row) {
  return fmt::format("{:.0f}, {:.0f} | {:.0f} | {:.2f}; {:.1f}, {:.1f}", row.error_m(0.5), row.error_m(0.95),
                     row.sigma_m(), row.nees.mean(), 100 * row.nees.share_50(), 100 * row.nees.share_95());
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App app("Flights whose camera goes blind, with an inertial sensor and without. No frames.", "blind");
  int flights = 300;
  std::uint64_t seed = 1;
  app.add_option("--flights", flights, "of each kind")->check(CLI::Range(20, 1000000))->capture_default_str();
  app.add_option("--seed", seed, "determines everything")->capture_default_str();
  int seen_s = BlindOptions{}.seen_s;
  app.add_option("--seen-s", seen_s, "before the camera goes blind")
      ->check(CLI::Range(30, 3600))
      ->capture_default_str();
  bool raw_imu = false;
  app.add_flag("--raw-imu", raw_imu, "as ArduPilot's RAW_IMU: 40 samples a second, in whole mrad/s and mg");
  CLI11_PARSE(app, argc, argv);
  std::cout << fmt::format(
                   "{} flights of each kind, seed {}. Errors: median, 95 %. NEES: mean (right: 2); percent "
                   "within the 50 % and the 95 % ellipse\n\n",
                   flights, seed)
            << "| blind | with IMU: error, m | median σ, m | NEES | without: error, m | median σ, m | NEES |\n"
            << "|---|---|---|---|---|---|---|\n";
  constexpr const char* kTurns[] = {"straight on", "one turn", "two opposite turns"};
  for (const int seconds : {15, 30, 60}) {
    for (int turns = 0; turns <= 2; ++turns) {
      Row with, without;
      for (int i = 0; i < flights; ++i) {
        const Random random = Random(seed).fork("blind", static_cast<std::uint64_t>(i));
        for (const bool imu : {true, false}) {
          BlindOptions options;
          options.blind_s = seconds;
          options.turns = turns;
          options.turn_sign = i % 2 == 0 ? 1 : -1;
          options.imu = imu;
          options.seen_s = seen_s;
          if (raw_imu) {
            options.rate_hz = 40;
            options.spoil = round_as_raw_imu;
          }
          const BlindEnd end = fly_blind(random, options);
          Row& row = imu ? with : without;
          row.errors_m.push_back(end.error_m);
          row.sigmas_m.push_back(end.sigma_m);
          row.nees.add(end.nees);
        }
      }
      std::cout << fmt::format("| {} s, {} | {} | {} |\n", seconds, kTurns[turns], cells(with), cells(without))
                << std::flush;
    }
  }
  return 0;
}
