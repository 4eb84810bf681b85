// A flight of hundreds of frames up and down over a world in memory, with one fault throughout, or all of them.
#pragma once

#include <functional>
#include <span>

#include "safety_camera.hpp"
#include "safety_record.hpp"
#include "vision/map_matcher.hpp"

namespace nadir::bench {

// The result of one long flight as a line of CSV, and of all flights as a table by condition.
struct LongRecord : Record {
  int within_20 = 0, within_50 = 0;                  // frames this close to the truth, online …
  int refined_within_20 = 0, refined_within_50 = 0;  // … and after the flight
  int refined_in_95 = 0;                             // in the ellipse, after the flight
  int losses = 0;                                    // odometry failed, or the frame was missing
  int recovered = 0;                                 // of these: anchored again
  int longest_recovery = 0;                          // usable frames until then
  double error_sum_m = 0;                            // of the frames with a position
  double cpu_ms = 0;  // that the localizer took: the one number that differs from run to run
};

// second: what SecondMatcherOptions names.
std::string long_header(std::uint64_t base_seed, int worlds, int frames, const std::string& second);
std::string line(const LongRecord& record);
LongRecord long_record_of(const std::string& line);  // throws Error when it is none

std::string long_summary(const std::map<std::uint64_t, LongRecord>& records);

struct LongCondition {
  std::string_view name;
  bool outliers = false;  // one frame in fifty shows a place 350 m off
  bool blackout = false;  // a fifth of the frames, in stretches of 4 to 20
  double height_factor = 1, heading_off_deg = 0;
  bool imu = false;          // the telemetry carries the accelerometer's change of velocity
  double deviation_deg = 0;  // of the compass: at most, by the course
  bool night = false;
  bool old_map = false;  // half of the map has changed
};

std::span<const LongCondition> long_conditions();

class LongFlights {
 public:
  // Makes the worlds. Base seeds from a million on judge: over worlds that nothing was fitted to.
  LongFlights(int worlds, int frames, std::uint64_t base_seed, MapMatcherFactory matcher);

  // The same record for the same seeds; may be called by several threads. The condition is index modulo how many there
  // are. talk: receives a line for every frame.
  LongRecord run(std::uint64_t base_seed, std::uint64_t index,
                 const std::function<void(const std::string&)>& talk) const;

 private:
  int frames_;
  Photographer photographer_;
  Worlds worlds_;
  MapMatcherFactory matcher_;
};

}  // namespace nadir::bench
