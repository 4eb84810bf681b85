// How a simulated autopilot estimates its position: accelerations integrated, positions let in by a gate, both axes
// with one covariance. Without positions it holds its airspeed and the wind that it estimated.
#pragma once

#include <Eigen/Core>

#include "geodesy/plane_point.hpp"

namespace nadir {

class PositionFilter {
 public:
  PositionFilter(PlanePoint place, const Eigen::Vector2d& velocity_mps);

  void predict(double seconds, const Eigen::Vector2d& acceleration_mps2);
  // A few times a second. aided: positions come in, so that the wind is learned instead of used.
  void hold_airspeed(const Eigen::Vector2d& air_velocity_mps, bool aided);

  // False: the place lies beyond `gate` standard deviations.
  bool fuse(PlanePoint place, double sigma_m, double gate);
  void fuse_velocity(const Eigen::Vector2d& velocity_mps, double sigma_mps);
  void reset(PlanePoint place, double sigma_m);

  PlanePoint place() const { return PlanePoint(position_); }
  const Eigen::Vector2d& velocity_mps() const { return velocity_; }
  double sigma_m() const;

 private:
  Eigen::Vector2d position_, velocity_, wind_ = Eigen::Vector2d::Zero();
  double pp_ = 4, pv_ = 0, vv_ = 1;  // covariance of position and velocity, each axis
};

}  // namespace nadir
