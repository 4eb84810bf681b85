// The river, the main road and the ponds: curves across the whole world.
#pragma once

#include "base/random.hpp"
#include "simulation/landscape.hpp"

namespace nadir {

void lay_ways(const Random& random, Landscape& land);

// A Catmull-Rom curve through the knots, a point about every step_m.
std::vector<Spot> smooth_curve(const std::vector<Spot>& knots, double step_m);

}  // namespace nadir
