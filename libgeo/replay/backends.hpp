// The odometry front ends and map matchers by their names on the command line and in recordings.
#pragma once

#include <string_view>

#include "estimation/odometry.hpp"
#include "vision/map_matcher.hpp"

namespace nadir {

// Throw UsageError for a name that is not among them.
OdometryFactory odometry_named(std::string_view name);     // features, flow
MapMatcherFactory matcher_named(std::string_view name);  // channels

}  // namespace nadir
