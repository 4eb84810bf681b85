// A position on the WGS84 ellipsoid. In degrees, as in maps, files and GeographicLib; every other angle in this code is
// in radians.
#pragma once

namespace nadir {

struct LonLat {
  double lon_deg = 0;
  double lat_deg = 0;

  bool operator==(const LonLat&) const = default;
};

}  // namespace nadir
