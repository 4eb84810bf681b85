// The lens as an adjustment of a whole flight (flight_adjustment.hpp) determined it, against its nominal values.
//
// It belongs to the poses of the same adjustment: an adjusted height and an adjusted focal length make up for each
// other, so that poses with the nominal lens, or the lens with other poses, are worse than both as they were.
#pragma once

#include <array>
#include <cmath>

#include "vision/camera.hpp"

namespace nadir {

struct AdjustedLens {
  double log_focal = 0;                // ln(focal length / nominal focal length)
  std::array<double, 5> distortion{};  // k1 k2 p1 p2 k3, in place of the nominal ones

  CameraModel applied_to(const CameraModel& nominal) const {
    CameraModel camera = nominal;
    camera.fx *= std::exp(log_focal);
    camera.fy *= std::exp(log_focal);
    camera.distortion = distortion;
    return camera;
  }
  bool operator==(const AdjustedLens&) const = default;
};

// Far beyond what an adjustment's priors allow: a stored lens that has more was not made by one.
inline constexpr double kMostLensLogFocal = 1, kMostLensDistortion = 10;

}  // namespace nadir
