// An anchor that tells where the camera was and nothing else, for tests of the flight filter.
#pragma once

#include "estimation/pose_measurements.hpp"

namespace nadir::test {

// at: east, north (m); sigma_m: of each axis.
inline PoseMeasurement position_measurement(const Eigen::Vector2d& at, double sigma_m) {
  PoseMeasurement measurement;
  measurement.value << at, 0, 0, 0, 0;
  measurement.covariance = Eigen::Matrix<double, 6, 6>::Identity() * 1e8;
  measurement.covariance.topLeftCorner<2, 2>() = Eigen::Matrix2d::Identity() * sigma_m * sigma_m;
  return measurement;
}

}  // namespace nadir::test
