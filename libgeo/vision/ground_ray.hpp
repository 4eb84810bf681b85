// Where a ray meets the ground for the first time.
//
// The ray is followed in steps that are a share of its clearance above ground, within bounds: long ones high up, short
// ones along a slope. The step in which it goes below ground is halved until the point is known.
#pragma once

#include <Eigen/Core>
#include <optional>

#include "vision/ground_surface.hpp"

namespace nadir {

struct GroundMarch {
  double share = 0;                // of the clearance: a step
  double least_m = 0, most_m = 0;  // bounds of a step
  double range_m = 0;              // along the ray; beyond it there is no ground
  int bisections = 0;              // of the last step
};

// from: east, north, up in the map's plane. direction: of length 1. Nothing: no ground within the range, or `from` is
// not above ground.
std::optional<Eigen::Vector3d> first_ground_point(const Eigen::Vector3d& from, const Eigen::Vector3d& direction,
                                                  const GroundSurface& ground, const GroundMarch& march);

}  // namespace nadir
