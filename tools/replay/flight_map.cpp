#include "replay/flight_map.hpp"

#include <algorithm>

#include "estimation/localizer.hpp"
#include "trust/root.hpp"
#include "vision/place_index_check.hpp"

namespace nadir {

Opening open_flight_map(const FlightMapPaths& paths, UtcTime now, Progress& progress) {
  const TrustRoot root = read_trusted_root(paths.trust);
  VerifyOptions options;
  options.root = &root;
  options.at = now;
  options.airframe = paths.airframe;
  Opening opening = open_package(paths.package, options, progress);
  verify_place_index(paths.package, options.depth, progress, opening);
  return opening;
}

double map_sigma_m(const CheckedTiles& tiles) {
  std::int64_t ce90_mm = 0;
  for (const Sidecar& tile : tiles.sidecars()) ce90_mm = std::max(ce90_mm, tile.ce90_mm);
  return map_sigma_from_ce90(static_cast<double>(ce90_mm) / 1000);
}

}  // namespace nadir
