#include "estimation/pose_sights.hpp"

#include <Eigen/LU>
#include <cmath>

namespace nadir {

PoseMeasurement pose_sight(const SolvedPose& solved, double measured_agl_m, const Eigen::Vector2d& measured_tilt_rad) {
  Eigen::Matrix<double, 6, 1> vague;
  const double far_m = 10 * measured_agl_m;
  vague << far_m, far_m, 1, 1, 1, 1;
  const Eigen::Matrix<double, 6, 6> weak = vague.cwiseProduct(vague).cwiseInverse().asDiagonal();
  const Attitude& attitude = solved.pose.attitude;
  PoseMeasurement sight;
  sight.covariance = (solved.measurement_information + weak).inverse();
  sight.seen << solved.pose.position.east_m, solved.pose.position.north_m, std::log(solved.pose.agl_m / measured_agl_m),
      attitude.heading_rad, attitude.pitch_rad - measured_tilt_rad.x(), attitude.roll_rad - measured_tilt_rad.y();
  sight.seen += sight.covariance * solved.measurement_gradient;
  return sight;
}

}  // namespace nadir
