#include "estimation/map_sigma.hpp"

#include <algorithm>

#include "estimation/localizer.hpp"

namespace nadir {

double map_sigma_m(const CheckedTiles& tiles) {
  std::int64_t ce90_mm = 0;
  for (const Sidecar& tile : tiles.sidecars()) ce90_mm = std::max(ce90_mm, tile.ce90_mm);
  return map_sigma_from_ce90(static_cast<double>(ce90_mm) / 1000);
}

}  // namespace nadir
