#include "adjustment/pose_covariance.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

#include "adjustment/adjustment_parameters.hpp"

namespace nadir {

Attitude attitude_from_matrix(const Eigen::Matrix3d& world_from_camera) {
  // With enu_from_camera() = enu_from_ned · ned_from_body(heading, pitch, roll) · body_from_camera.
  Eigen::Matrix3d enu_from_ned;
  enu_from_ned << 0, 1, 0, 1, 0, 0, 0, 0, -1;
  const Eigen::Matrix3d body_from_camera = enu_from_ned.transpose() * enu_from_camera({});
  const Eigen::Matrix3d ned_from_body = enu_from_ned.transpose() * world_from_camera * body_from_camera.transpose();
  return {std::atan2(ned_from_body(1, 0), ned_from_body(0, 0)), std::asin(std::clamp(-ned_from_body(2, 0), -1.0, 1.0)),
          std::atan2(ned_from_body(2, 1), ned_from_body(2, 2))};
}

Eigen::Matrix3d skew(const Eigen::Vector3d& v) {
  Eigen::Matrix3d cross;
  cross << 0, -v.z(), v.y(), v.z(), 0, -v.x(), -v.y(), v.x(), 0;
  return cross;
}

Eigen::Matrix3d rotation_from_vector(const Eigen::Vector3d& vector) {
  const double angle = vector.norm();
  if (angle == 0) return Eigen::Matrix3d::Identity();
  return Eigen::AngleAxisd(angle, vector / angle).toRotationMatrix();
}

Eigen::Matrix3d turn_by_angles(const Attitude& attitude) {
  const Eigen::Matrix3d camera_from_world = enu_from_camera(attitude).transpose();
  Eigen::Matrix3d by;
  for (int i = 0; i < 3; ++i) {
    Attitude more = attitude, less = attitude;
    constexpr double step = parameters::adjustment::kRotationStep_rad;
    (i == 0 ? more.heading_rad : i == 1 ? more.pitch_rad : more.roll_rad) += step;
    (i == 0 ? less.heading_rad : i == 1 ? less.pitch_rad : less.roll_rad) -= step;
    const Eigen::Matrix3d turn = camera_from_world * (enu_from_camera(more) - enu_from_camera(less)) / (2 * step);
    by.col(i) = 0.5 * Eigen::Vector3d(turn(2, 1) - turn(1, 2), turn(0, 2) - turn(2, 0), turn(1, 0) - turn(0, 1));
  }
  return by;
}

PoseCovariance pose_covariance(const CameraPose& pose, const Eigen::Matrix<double, 6, 6>& of_filter) {
  Eigen::Matrix<double, 6, 6> by = Eigen::Matrix<double, 6, 6>::Zero();
  by(0, 0) = by(1, 1) = 1;
  by(2, 2) = pose.agl_m;
  by.bottomRightCorner<3, 3>() = turn_by_angles(pose.attitude);
  return by * of_filter * by.transpose();
}

}  // namespace nadir
