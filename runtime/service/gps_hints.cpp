#include "service/gps_hints.hpp"

#include <cmath>

#include "geodesy/local_frame.hpp"

namespace nadir {

bool GpsHints::due(LonLat place, bool position_known) {
  if (told_) {
    if (position_known) return false;
    const Enu moved = LocalFrame(*told_).enu_from_lonlat(place);
    if (!(std::hypot(moved.east_m, moved.north_m) >= kGpsHintRadius_m / 2)) return false;
  }
  told_ = place;
  return true;
}

}  // namespace nadir
