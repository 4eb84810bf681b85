// The odometry front ends and place matchers by the names that the command line knows.
#pragma once

#include <string_view>

#include "estimation/visual_odometry.hpp"
#include "vision/place_matcher.hpp"

namespace nadir {

// Throw UsageError for a name that is not among them.
OdometryFactory odometry_named(std::string_view name);     // features
MapMatcherFactory matcher_named(std::string_view name);  // channels, sift

}  // namespace nadir
