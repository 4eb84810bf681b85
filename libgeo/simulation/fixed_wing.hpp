// A fixed wing as a moving point: constant airspeed, banked turns, wind with gusts, a body that never sits quite still.
// Its plane is a LocalFrame's: east, north, up.
#pragma once

#include <Eigen/Core>
#include <array>

#include "geodesy/plane_point.hpp"
#include "simulation/gauss_markov.hpp"
#include "vision/camera.hpp"

namespace nadir {

struct FixedWingStart {
  PlanePoint place;
  double altitude_m = 0;
  double heading_rad = 0;
  double airspeed_mps = 22;
  Eigen::Vector2d wind_mps = Eigen::Vector2d::Zero();  // blowing to east, north
};

class FixedWing {
 public:
  FixedWing(const FixedWingStart& start, Random random);

  // lateral_mps2: wanted acceleration to the right. It banks for it as far and as fast as it can.
  void step(double seconds, double lateral_mps2);

  PlanePoint place() const { return {position_.x(), position_.y()}; }
  double altitude_m() const { return altitude_m_; }
  const Eigen::Vector2d& velocity_mps() const { return velocity_; }  // over ground
  const Eigen::Vector2d& acceleration_mps2() const { return acceleration_; }
  Eigen::Vector2d air_velocity_mps() const;
  const Attitude& attitude() const { return attitude_; }
  const Eigen::Vector3d& rates_rad_s() const { return rates_; }  // of the body about its axes: forward, right, down
  Eigen::Vector3d specific_force_mps2() const;                   // what accelerometers feel: forward, right, down

  // Turn rate and specific force as a sensor with an anti-aliasing filter has them: means since the last call.
  struct Inertial {
    Eigen::Vector3d rate_rad_s, force_mps2;
  };
  Inertial take_inertial();

 private:
  Attitude shaken() const;

  Random random_;
  Eigen::Vector2d position_, wind_;
  double altitude_m_, heading_rad_, airspeed_mps_, bank_rad_ = 0;
  std::array<GaussMarkovProcess, 2> gusts_;
  std::array<GaussMarkovProcess, 3> shake_;
  Eigen::Vector2d velocity_, acceleration_ = Eigen::Vector2d::Zero();
  Attitude attitude_;
  Eigen::Vector3d rates_ = Eigen::Vector3d::Zero();
  Eigen::Vector3d turned_ = Eigen::Vector3d::Zero(), pulled_ = Eigen::Vector3d::Zero();  // sums since then
  double since_s_ = 0;
};

}  // namespace nadir
