// Measurements of camera poses by images alone: linear, with Gaussian noise and without any prior, for the flight
// filter. Both solvers return the information of the image without their priors; where it is singular (a direction that
// the image does not constrain) the covariance here is practically infinite.
#pragma once

#include <Eigen/Cholesky>
#include <Eigen/Core>

#include "vision/camera_pose_solver.hpp"
#include "vision/localizer_parameters.hpp"

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

// The covariance with which a filter takes a measurement (R) that is none with the chance d, because what was found is
// a chance peak beside the truth. Probabilistic data association (Bar-Shalom and Tse 1975) multiplies the gain by
// 1 - d. A sure measurement has that gain with the covariance
//   (R + d B) / (1 - d)
// where B is the predicted covariance. A chance peak lies beside the truth: of a prediction that is much wider than the
// measurement only what is around it counts, B = (P⁻¹ + (kWidestPrior R)⁻¹)⁻¹.
template <int N>
Eigen::Matrix<double, N, N> weighted_by_association(const Eigen::Matrix<double, N, N>& measured, double doubt,
                                                    const Eigen::Matrix<double, N, N>& predicted) {
  const Eigen::Matrix<double, N, N> widest = parameters::pose_measurement::kWidestPrior * measured;
  const Eigen::Matrix<double, N, N> beside = predicted * (predicted + widest).ldlt().solve(widest);
  return (measured + doubt / 2 * (beside + beside.transpose())) / (1 - doubt);
}

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
