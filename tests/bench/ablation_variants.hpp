// The localizer with one step of its method left out, or another backend in its place.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "estimation/visual_odometry.hpp"
#include "vision/map_matcher.hpp"

namespace nadir::bench {

struct Variant {
  std::string name;
  MapMatcherFactory matcher;
};

// full; no means removed; one channel; grey; SIFT; the image centre.
std::vector<Variant> matcher_variants();

// The same matcher or front end; each call's CPU time in ms is added to the list, which must outlive what is made.
MapMatcherFactory timed(MapMatcherFactory made, std::vector<double>& spent_ms);
OdometryFactory timed(OdometryFactory made, std::vector<double>& spent_ms);

}  // namespace nadir::bench
