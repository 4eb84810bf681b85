// Small turns of a camera, and the covariance of its pose: of (east, north, up [m], turn about the camera's x, y and z
// axes [rad]), so that the true attitude is world_from_camera · Exp(turn).
#pragma once

#include <Eigen/Core>

#include "vision/rectification.hpp"

namespace nadir {

using PoseCovariance = Eigen::Matrix<double, 6, 6>;

// From that of (east m, north m, log height above ground, heading, pitch, roll), in which the flight filter and the
// pose solver state theirs.
PoseCovariance pose_covariance(const CameraPose& pose, const Eigen::Matrix<double, 6, 6>& of_filter);

// How the camera turns about its axes when heading, pitch and roll change a little.
Eigen::Matrix3d turn_by_angles(const Attitude& attitude);

// The inverse of enu_from_camera().
Attitude attitude_from_matrix(const Eigen::Matrix3d& world_from_camera);

// Exp: the rotation by |vector| rad about it; and the matrix of the cross product with v.
Eigen::Matrix3d rotation_from_vector(const Eigen::Vector3d& vector);
Eigen::Matrix3d skew(const Eigen::Vector3d& v);

}  // namespace nadir
