// How far a map itself may be out of place.
#pragma once

#include "package/open_package.hpp"

namespace nadir {

// One axis' sigma: from the worst accuracy (CE90) that the package's tiles state.
double map_sigma_m(const CheckedTiles& tiles);

}  // namespace nadir
