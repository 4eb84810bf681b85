// Ground that is no level plane: its slope feigns a tilt of the camera.
#pragma once

#include <Eigen/Core>

#include "estimation/pose_sights.hpp"
#include "vision/ground_surface.hpp"

namespace nadir {

// Rise over run to the east and the north, over a stretch to both sides.
Eigen::Vector2d ground_slope(const GroundSurface& surface, PlanePoint at, double stretch_m);

// Sights over a plane take its slope for a tilt, of both pictures alike, turned with the aircraft: makes the sight as
// unsure of tilt as the slope is unknown (rise over run, one sigma).
void add_unknown_slope(RelativeMotionMeasurement& sight, double slope_sigma);

}  // namespace nadir
