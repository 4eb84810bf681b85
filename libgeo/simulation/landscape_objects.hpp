// Houses, gardens, streets and farms.
#pragma once

#include "base/random.hpp"
#include "simulation/landscape.hpp"

namespace nadir {

void build_village(const Random& random, Landscape& land);
void build_farms(const Random& random, Landscape& land);

// Trees: woods, hedges, avenues, orchards, river banks, single ones in meadows; and bales on the stubble.

void plant_trees(const Random& random, const std::vector<BorderLine>& borders, Landscape& land);

}  // namespace nadir
