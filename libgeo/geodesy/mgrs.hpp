// The Military Grid Reference System, in which operators say and hear positions: "33UXP0437088512" is a square of 1 m.
//
//   33    zone of UTM, 6° of longitude; none at the poles (UPS)
//   U     band of 8° of latitude
//   XP    square of 100 km
//   04370 88512   easting and northing within it, as many digits each as the square is small: 5 for 1 m, 0 for 100 km
#pragma once

#include <optional>
#include <string>
#include <string_view>

#include "geodesy/lon_lat.hpp"

namespace nadir {

// The middle of the square. Blanks between the parts do not count, nor does the case. nullopt for what is no reference
// of a square of 1 km or less: a larger one is no position.
std::optional<LonLat> lonlat_from_mgrs(std::string_view text);

// The square of 1 m that holds the place: "33U XP 04370 88512", as it is spoken. Empty for what is no place on Earth.
std::string mgrs_from_lonlat(LonLat place);

}  // namespace nadir
