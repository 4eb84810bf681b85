// Where a position comes from: how far everything downstream may rely on it. The names are stable.
#pragma once

#include <string_view>

namespace nadir {

enum class SourceLabel {
  satellite_anchored,  // this frame itself was matched with fresh, trusted map
  vo_extrapolated,     // propagated from the last anchor by visual odometry
  dead_reckoned,       // propagated by velocity or IMU alone
  no_fix,              // not known well enough to be published
};

constexpr std::string_view name_of(SourceLabel label) {
  switch (label) {
    case SourceLabel::satellite_anchored: return "satellite_anchored";
    case SourceLabel::vo_extrapolated: return "vo_extrapolated";
    case SourceLabel::dead_reckoned: return "dead_reckoned";
    case SourceLabel::no_fix: return "no_fix";
  }
  return "no_fix";
}

}  // namespace nadir
