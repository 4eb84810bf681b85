// Measurements of camera poses by images alone: linear, with Gaussian noise and without any prior, for the flight
// filter. Both solvers return the information of the image without their priors; where it is singular (a direction that
// the image does not constrain) the covariance here is practically infinite.
#pragma once

#include <Eigen/Core>

#include "vision/camera_pose_solver.hpp"

namespace nadir {

// The telemetry's values that the filter's height and tilt states are relative to.
struct TelemetryReference {
  double agl_m = 0;
  Eigen::Vector2d tilt_rad = Eigen::Vector2d::Zero();  // pitch, roll
};

// One frame against the map: z = (east m, north m, log of true over measured height, heading, pitch and roll beyond the
// telemetry's).
struct PoseMeasurement {
  Eigen::Matrix<double, 6, 1> value;
  Eigen::Matrix<double, 6, 6> covariance;
};

PoseMeasurement pose_measurement(const SolvedPose& solved, const TelemetryReference& reference);

// The attitude and height that a frame was processed with.
struct LinearizationPoint {
  double log_height = 0;
  double heading_rad = 0;
  double pitch_rad = 0;  // beyond the telemetry's, as is …
  double roll_rad = 0;   // … this
};

// Two frames against each other: z = (displacement east, north in m; corrections of the linearization points: change of
// the log height, change of heading, pitch and roll before, pitch and roll now). The displacement has the scale and the
// directions of the linearization point of the frame before.
struct RelativeMotionMeasurement {
  Eigen::Matrix<double, 8, 1> value;
  Eigen::Matrix<double, 8, 8> covariance;
  LinearizationPoint before, now;
};

// Ground that is not a level plane looks like a tilt, the same one in both images, turned with the aircraft: makes the
// measurement as uncertain of tilt as the slope is unknown (slope_sigma: rise over run).
void inflate_unknown_slope(RelativeMotionMeasurement& measurement, double slope_sigma);

}  // namespace nadir
