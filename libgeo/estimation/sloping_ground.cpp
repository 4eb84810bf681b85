#include "estimation/sloping_ground.hpp"

#include <cmath>

namespace nadir {

Eigen::Vector2d ground_slope(const GroundSurface& surface, PlanePoint at, double stretch_m) {
  const auto rise = [&](double east, double north) {
    return surface.height_m({at.east_m + east * stretch_m, at.north_m + north * stretch_m}) -
           surface.height_m({at.east_m - east * stretch_m, at.north_m - north * stretch_m});
  };
  return Eigen::Vector2d(rise(1, 0), rise(0, 1)) / (2 * stretch_m);
}

void add_unknown_slope(RelativeMotionMeasurement& sight, double slope_sigma) {
  const double turn = sight.now.heading_rad - sight.before.heading_rad + sight.seen[3];
  Eigen::Matrix<double, 4, 2> tilt_from_slope;
  tilt_from_slope << 1, 0, 0, 1, std::cos(turn), -std::sin(turn), std::sin(turn), std::cos(turn);
  sight.covariance.bottomRightCorner<4, 4>() +=
      slope_sigma * slope_sigma * tilt_from_slope * tilt_from_slope.transpose();
}

}  // namespace nadir
