// The 1-sigma error ellipse of a horizontal covariance.
//
// With variances a (east), b (north) and covariance c, the semi-axes are √((a + b)/2 ± √(((a - b)/2)² + c²)), and the
// major one lies at ½ atan2(2c, a - b) from east towards north.
#pragma once

#include <algorithm>
#include <cmath>

#include "geodesy/angles.hpp"
#include "geodesy/hypotenuse.hpp"

namespace nadir {

struct ErrorEllipse {
  double major_m = 0, minor_m = 0;  // semi-axes
  double bearing_deg = 0;           // of the major one, clockwise from north, 0 to 180
};

inline ErrorEllipse error_ellipse(double east_var_m2, double east_north_cov_m2, double north_var_m2) {
  const double mean = 0.5 * (east_var_m2 + north_var_m2);
  const double half_gap = 0.5 * (east_var_m2 - north_var_m2);
  const double radius = hypotenuse(half_gap, east_north_cov_m2);
  double bearing_deg = 90 - degrees(0.5 * std::atan2(east_north_cov_m2, half_gap));
  if (bearing_deg >= 180) bearing_deg -= 180;
  return {std::sqrt(std::max(0.0, mean + radius)), std::sqrt(std::max(0.0, mean - radius)), bearing_deg};
}

}  // namespace nadir
