// Where a position comes from, in one word: what everybody downstream may make of it.
#pragma once

#include <string_view>

namespace nadir {

enum class SourceLabel {
  satellite_anchored,  // this frame itself was matched with fresh, trusted map
  vo_extrapolated,     // carried from the last anchor by visual odometry
  dead_reckoned,       // carried by velocity or IMU alone
  no_fix,              // not known well enough to be said
};

std::string_view name_of(SourceLabel label);

}  // namespace nadir
