// When a GPS that is trusted says where to look first. Never where we are: only the map may confirm it.
#pragma once

#include <optional>

#include "geodesy/lon_lat.hpp"

namespace nadir {

inline constexpr double kGpsHintRadius_m = 150;

class GpsHints {
 public:
  // Whether this place is to be told: the first one, and for as long as pictures know no position each that is half a
  // radius from the last one told, because a hint from before take-off is worth nothing in the air.
  bool due(LonLat place, bool position_known);

 private:
  std::optional<LonLat> told_;
};

}  // namespace nadir
