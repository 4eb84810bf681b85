#include "replay/flight_map.hpp"

#include "trust/root.hpp"
#include "vision/place_index.hpp"

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

}  // namespace nadir
