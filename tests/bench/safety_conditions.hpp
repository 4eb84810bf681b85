// The condition of a segment: one fault, or none.
#pragma once

#include <span>
#include <string_view>

#include "base/random.hpp"

namespace nadir::bench {

enum class Fault {
  none,
  old_map,
  heading_bias,  // 8 degrees
  deviation,     // up to 9 degrees, by the course
  height_scale,  // 15 %
  map_shift,     // the whole map
  map_part,      // what lies beyond a border across the flight path, as a scene of a mosaic
  mirrored_map,
  other_region,
  frozen,    // the same image from some frame on
  repeated,  // one image twice
  black,
  clouds,
  blur,
  night,
  blackout,  // a fifth of the frames
  water,     // nothing but the camera's own picture, for two frames or from some frame on
  outlier,   // one frame from 350 m away
  time_jump,
  no_attitude,  // NaN
};

struct Condition {
  std::string_view name;
  Fault fault;
  double amount = 0;  // of map_shift and map_part: metres
  double weight = 1;  // how often it is drawn
};

std::span<const Condition> conditions();
const Condition& draw_condition(Random& random);

}  // namespace nadir::bench
