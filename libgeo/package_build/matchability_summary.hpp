// What a planner has to know of a matchability map: how much of the ground is good, and how far the route runs without
// a place where the flight can be sure of itself.
#pragma once

#include <array>
#include <vector>

#include "package_build/matchability_survey.hpp"

namespace nadir {

// From one place on the route to another one further along it.
struct RouteStretch {
  LonLat from, to;
  double begin_m = 0;  // along the route
  double length_m = 0;
};

struct MatchabilitySummary {
  std::array<std::size_t, 4> cells{};      // by MatchClass; outside: 0
  std::array<double, 4> route_m{};         // by MatchClass; outside: beyond the map
  std::vector<RouteStretch> without_good;  // all of them, the longest first

  std::size_t places() const;
  double share(MatchClass cls) const;  // of the places, 0 without any
  double route_length_m() const;
  double route_share(MatchClass cls) const;
};

MatchabilitySummary summarise(const MatchabilityMap& map, const std::vector<LonLat>& route, const LocalFrame& frame);

}  // namespace nadir
