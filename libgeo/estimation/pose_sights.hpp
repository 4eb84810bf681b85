// What pictures alone say of poses: linear measurements without any prior in them, for the flight filter.
#pragma once

#include <Eigen/Core>

#include "vision/camera_pose_solver.hpp"

namespace nadir {

// Of one frame against the map: (east m, north m, log of true over told height, heading, pitch and roll beyond the
// telemetry's), in this order.
struct PoseMeasurement {
  Eigen::Matrix<double, 6, 1> seen;
  Eigen::Matrix<double, 6, 6> covariance;
};

// measured_tilt_rad: pitch and roll of the telemetry, which the sight counts from, as height from measured_agl_m. What the
// sights do not say at all gets a covariance so large that it says nothing either.
PoseMeasurement pose_sight(const SolvedPose& solved, double measured_agl_m, const Eigen::Vector2d& measured_tilt_rad);

// What a frame's attitude and height were believed to be when it was looked at.
struct Believed {
  double log_height = 0;
  double heading_rad = 0;
  double pitch_rad = 0;  // beyond the telemetry's, as are …
  double roll_rad = 0;   // … these
};

// Of two frames against each other: (motion east, north in m; and what to add to the beliefs: change of the height's
// logarithm, change of heading, pitch and roll before, pitch and roll now). The motion has the scale and the directions
// of the beliefs about the frame before.
struct RelativeMotionMeasurement {
  Eigen::Matrix<double, 8, 1> seen;
  Eigen::Matrix<double, 8, 8> covariance;
  Believed before, now;
};

}  // namespace nadir
