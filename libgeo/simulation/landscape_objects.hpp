// What stands on a landscape: houses, gardens, streets and farms; woods, hedges, avenues, orchards, river banks, single
// trees in meadows, and bales on the stubble.
#pragma once

#include "base/random.hpp"
#include "simulation/landscape.hpp"

namespace nadir {

void build_village(const Random& random, Landscape& land);
void build_farms(const Random& random, Landscape& land);
void plant_trees(const Random& random, const std::vector<BorderLine>& borders, Landscape& land);

}  // namespace nadir
