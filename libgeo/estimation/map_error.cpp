#include "estimation/map_error.hpp"

#include <algorithm>
#include <cstdint>

#include "package/open_package.hpp"
#include "vision/localizer_parameters.hpp"

namespace nadir {

using namespace parameters::localizer;

double map_sigma_from_ce90(double ce90_m) { return ce90_m / kCe90OverSigma; }

double map_sigma_m(const CheckedTiles& tiles) {
  std::int64_t ce90_mm = 0;
  for (const Sidecar& tile : tiles.sidecars()) ce90_mm = std::max(ce90_mm, tile.ce90_mm);
  return map_sigma_from_ce90(static_cast<double>(ce90_mm) / 1000);
}

double map_sigma_of(const AnchorMatch& match, const std::optional<double>& configured_m) {
  if (configured_m) return *configured_m;
  return match.map_ce90_m ? map_sigma_from_ce90(*match.map_ce90_m) : kMapSigma_m;
}

double unmodelled_variance_m2(double agl_m) {
  const double sigma_m = parameters::anchor_measurement::kUnmodelledShare * agl_m;
  return sigma_m * sigma_m;
}

Eigen::Matrix2d shared_error_m2(double map_sigma_m, double agl_m) {
  return Eigen::Matrix2d::Identity() * (map_sigma_m * map_sigma_m + unmodelled_variance_m2(agl_m));
}

}  // namespace nadir
