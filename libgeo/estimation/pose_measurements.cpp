#include "estimation/pose_measurements.hpp"

#include <Eigen/LU>
#include <cmath>

namespace nadir {

using namespace parameters::pose_measurement;

PoseMeasurement pose_measurement(const SolvedPose& solved, const TelemetryReference& reference) {
  Eigen::Matrix<double, 6, 1> vague;
  const double far_m = kVaguePositionHeights * reference.agl_m;
  vague << far_m, far_m, 1, 1, 1, 1;
  const Eigen::Matrix<double, 6, 6> weak = vague.cwiseProduct(vague).cwiseInverse().asDiagonal();
  const Attitude& attitude = solved.pose.attitude;
  PoseMeasurement measurement;
  measurement.covariance = (solved.measurement_information + weak).inverse();
  measurement.value << solved.pose.position.east_m, solved.pose.position.north_m,
      std::log(solved.pose.agl_m / reference.agl_m), attitude.heading_rad, attitude.pitch_rad - reference.tilt_rad.x(),
      attitude.roll_rad - reference.tilt_rad.y();
  measurement.value += measurement.covariance * solved.measurement_gradient;
  return measurement;
}

void inflate_unknown_slope(RelativeMotionMeasurement& measurement, double slope_sigma) {
  const double turn = measurement.now.heading_rad - measurement.before.heading_rad + measurement.value[3];
  Eigen::Matrix<double, 4, 2> tilt_from_slope;
  tilt_from_slope << 1, 0, 0, 1, std::cos(turn), -std::sin(turn), std::sin(turn), std::cos(turn);
  measurement.covariance.bottomRightCorner<4, 4>() +=
      slope_sigma * slope_sigma * tilt_from_slope * tilt_from_slope.transpose();
}

}  // namespace nadir
