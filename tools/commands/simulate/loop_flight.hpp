// The flight of a closed loop, in real time: the simulated aircraft, what happens to it, and what is measured.
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "cli/command.hpp"
#include "commands/simulate/loop_autopilot.hpp"

namespace nadir {

// What goes wrong, and when.
struct Circumstance {
  std::string name;
  double gps_fails_s = 0;
  bool spoofed = false;  // GPS is moved instead of denied
  std::optional<double> dark_from_s{}, dark_to_s{};
};

// name: denied, spoofed or blackout.
Circumstance circumstance(const std::string& name, double duration_s);

struct Spread {
  double median = 0, p95 = 0, worst = 0;
};

struct LoopFigures {
  double flown_s = 0, lap_m = 0, late_s = 0;  // late: most that it fell behind real time
  std::size_t fixes = 0;
  std::optional<Spread> fix_error_m{}, off_track_m{};
  double by_fixes_s = 0;                  // flown by nadird's positions
  std::optional<double> usable_from_s{};  // nadird's position was usable for the first time
  int frames = 0, frames_late = 0;        // late: delivered after the delay that nadird reckons with
  double unusable_s = 0;                  // since then
};

struct LoopFlightSetup {
  double duration_s = 0;
  Circumstance circumstance;
  std::string page;             // nadird's, "http://127.0.0.1:8750"
  std::filesystem::path track;  // CSV that is written
  std::function<void()> check;  // several times a second: throws when a program has ended
};

// Until the time is over, or Ctrl-C.
LoopFigures fly_loop(const LoopFlightSetup& setup, SimulatedAircraft& aircraft, LoopAutopilot& autopilot,
                     const LocalFrame& frame, Context& context);

}  // namespace nadir
