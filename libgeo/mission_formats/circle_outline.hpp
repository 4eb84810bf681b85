// A circle as programs without circles draw it.
#pragma once

#include <cmath>
#include <numbers>
#include <vector>

#include "geodesy/local_frame.hpp"

namespace nadir {

// 72 corners on the circle, without the closing one, counter-clockwise from the east.
inline std::vector<LonLat> circle_outline(LonLat centre, double radius_m) {
  constexpr int kCorners = 72;
  const LocalFrame frame(centre);
  std::vector<LonLat> outline;
  for (int i = 0; i < kCorners; ++i) {
    const double angle = 2 * std::numbers::pi * i / kCorners;
    outline.push_back(frame.lonlat_from_plane({radius_m * std::cos(angle), radius_m * std::sin(angle)}));
  }
  return outline;
}

}  // namespace nadir
