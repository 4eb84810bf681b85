// The protection level (belief.hpp) as a σ, for those who compute with one.
//
// A circular Gaussian of one-axis σ leaves a radius r with the probability exp(-r² / 2σ²). So a radius that is left
// with the probability `risk` is sqrt(-2 ln risk) sigmas: 4.80 for 1e-5. The other way round, the Gaussian that has no
// more than the risk beyond a protection level, whatever mixture that is the level of, has σ = hpl / sqrt(-2 ln risk).
#pragma once

#include <algorithm>
#include <cmath>
#include <optional>

namespace nadir {

// risk: above 0, below 1.
inline double sigmas_of_risk(double risk) { return std::sqrt(-2 * std::log(risk)); }

// σ, one axis, of a Gaussian that bounds both: the error that is usual and the one that is rare. Without a protection
// level no Gaussian does, and it is σ itself.
inline double bounding_sigma_m(double sigma_m, const std::optional<double>& hpl_m, double risk) {
  return hpl_m ? std::max(sigma_m, *hpl_m / sigmas_of_risk(risk)) : sigma_m;
}

}  // namespace nadir
