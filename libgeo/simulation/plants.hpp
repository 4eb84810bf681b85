// Trees: woods, hedges, avenues, orchards, river banks, single ones in meadows; and bales on the stubble.
#pragma once

#include "simulation/fields.hpp"

namespace nadir {

void plant_trees(const Random& random, const std::vector<BorderLine>& borders, Landscape& land);

}  // namespace nadir
