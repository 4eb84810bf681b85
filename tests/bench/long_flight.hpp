// A flight of hundreds of frames up and down over a world in memory, with one fault throughout, or all of them.
#pragma once

#include <functional>
#include <span>

#include "long_record.hpp"
#include "safety_camera.hpp"

namespace nadir::bench {

struct LongCondition {
  std::string_view name;
  bool outliers = false;  // one frame in fifty shows a place 350 m off
  bool blackout = false;  // a fifth of the frames, in stretches of 4 to 20
  double height_factor = 1, heading_off_deg = 0;
  bool imu = false;          // the telemetry carries the accelerometer's change of velocity
  double deviation_deg = 0;  // of the compass: at most, by the course
};

std::span<const LongCondition> long_conditions();

class LongFlights {
 public:
  LongFlights(int worlds, int frames);

  // The same record for the same seeds; may be called by several threads. The condition is index modulo how many there
  // are. talk: receives a line for every frame.
  LongRecord run(std::uint64_t base_seed, std::uint64_t index,
                 const std::function<void(const std::string&)>& talk) const;

 private:
  int frames_;
  Photographer photographer_;
  std::vector<std::unique_ptr<World>> worlds_;
};

}  // namespace nadir::bench
