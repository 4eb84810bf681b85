// NEES and NIS of the flight filter over thousands of drawn flights. docs/benchmarks.md.
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <iostream>

#include "estimation/consistency.hpp"

using namespace nadir;
using namespace nadir::test;

namespace {

struct Case {
  const char* name;
  DrawnOptions options;
};

std::vector<Case> cases() {
  std::vector<Case> all(7);
  all[0].name = "anchor every 10 s";
  all[1].name = "anchor every 60 s", all[1].options.anchor_every = 60;
  all[2].name = "20 s blind of 50", all[2].options.blind_every = 30;
  all[3].name = "20 s blind of 50, IMU", all[3].options.blind_every = 30, all[3].options.imu = true;
  all[4].name = "height to 15 %", all[4].options.uncertainty.agl_relative = 0.15;
  all[5].name = "heading to 8 deg", all[5].options.uncertainty.heading_rad = 0.14;
  all[6].name = "5 % wrong anchors accepted", all[6].options.wrong_anchor_share = 0.05;
  return all;
}

std::string tally(const Tally& t) {
  if (t.count == 0) return "-";
  return fmt::format("{:.2f}; {:.1f}, {:.1f}", t.mean(), 100 * t.share_50(), 100 * t.share_95());
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App app("Is the flight filter consistent? Random flights without frames.", "consistency");
  int flights = 500;
  std::uint64_t seed = 1;
  app.add_option("--flights", flights, "of each kind")->check(CLI::Range(1, 1000000))->capture_default_str();
  app.add_option("--seed", seed, "determines everything")->capture_default_str();
  CLI11_PARSE(app, argc, argv);
  const auto [low, high] = chi2_mean_interval(flights);
  std::cout
      << fmt::format(
             "{} flights of each kind, seed {}. Each cell: mean (right: 2); percent within the 50 % and "
             "the 95 % ellipse\n\n",
             flights, seed)
      << "| flights | NEES online | NEES blind | NEES refined | NIS of anchors | NIS expected | frames whose mean "
         "NEES is within its 95 % interval | RMS online, refined, m |\n|---|---|---|---|---|---|---|---|\n";
  for (const Case& c : cases()) {
    const Consistency flown = measure_consistency(flights, seed, c.options);
    const auto [nis_low, nis_high] = chi2_mean_interval(flown.anchors.count);
    std::cout << fmt::format("| {} | {} | {} | {} | {} | {:.2f} to {:.2f} | {} of {} | {:.1f}, {:.1f} |\n", c.name,
                             tally(flown.online), tally(flown.blind), tally(flown.smoothed), tally(flown.anchors),
                             nis_low, nis_high, flown.frames_within, c.options.frames, std::sqrt(flown.online_error_m2),
                             std::sqrt(flown.smoothed_error_m2))
              << std::flush;
  }
  std::cout << fmt::format("\nThe interval of a frame's mean over the flights: {:.2f} to {:.2f}\n", low, high);
  return 0;
}
