// Houses, gardens, streets and farms.
#pragma once

#include "base/random.hpp"
#include "simulation/landscape.hpp"

namespace nadir {

void build_village(const Random& random, Landscape& land);
void build_farms(const Random& random, Landscape& land);

}  // namespace nadir
