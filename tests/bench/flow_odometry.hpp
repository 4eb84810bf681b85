// A second odometry front end, which shows that the interface is independent of the backend. It is no faster than
// features and loses what they keep where little ground is shared or the heading is poorly known (docs/benchmarks.md).
#pragma once

#include "estimation/visual_odometry.hpp"

namespace nadir {

// No features: both images are resampled to the ground's north-up grid, correlated as wholes, and then patch by patch.
// Attitudes must be known to some degrees and a quarter of the image be shared.
std::unique_ptr<OdometryFrontEnd> make_flow_odometry();

}  // namespace nadir
