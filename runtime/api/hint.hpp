// What an operator believes: the aircraft is within radius_m of this place. A prior for the search, never taken as
// truth.
#pragma once

#include <optional>
#include <variant>

#include "geodesy/lon_lat.hpp"
#include "http/message.hpp"

namespace nadir {

inline constexpr double kMaxHintRadius_m = 100'000;

struct Hint {
  LonLat place;
  double radius_m = 0;  // above 0, at most kMaxHintRadius_m
};

// The body of POST /v1/hint: {"lat": …, "lon": …, "radius_m": …}, degrees.
std::variant<Hint, Problem> parse_hint(const ApiRequest& request);

}  // namespace nadir
