#include "simulation/fixed_wing.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

#include "geodesy/angles.hpp"
#include "geodesy/gravity.hpp"

namespace nadir {
namespace {

constexpr double kMaxBank_rad = radians(38), kMaxRollRate_rad_s = radians(40), kBankTime_s = 0.25;
constexpr double kAngleOfAttack_rad = radians(1.5);
constexpr double kGust_mps = 0.7, kGustTime_s = 8, kShakeTime_s = 0.8;

}  // namespace

FixedWing::FixedWing(const FixedWingStart& start, Random random)
    : random_(random),
      position_(start.place.east_m, start.place.north_m),
      wind_(start.wind_mps),
      altitude_m_(start.altitude_m),
      heading_rad_(start.heading_rad),
      airspeed_mps_(start.airspeed_mps),
      gusts_{GaussMarkovProcess(random_, kGust_mps, kGustTime_s), GaussMarkovProcess(random_, kGust_mps, kGustTime_s)},
      shake_{GaussMarkovProcess(random_, radians(0.6), kShakeTime_s),
             GaussMarkovProcess(random_, radians(0.4), kShakeTime_s),
             GaussMarkovProcess(random_, radians(0.3), kShakeTime_s)},
      velocity_(air_velocity_mps() + wind_ + Eigen::Vector2d(gusts_[0].value(), gusts_[1].value())),
      attitude_(shaken()) {}

Eigen::Vector2d FixedWing::air_velocity_mps() const {
  return airspeed_mps_ * Eigen::Vector2d(std::sin(heading_rad_), std::cos(heading_rad_));
}

Attitude FixedWing::shaken() const {
  return {.heading_rad = wrap_pi(heading_rad_ + shake_[2].value()),
          .pitch_rad = kAngleOfAttack_rad + shake_[1].value(),
          .roll_rad = bank_rad_ + shake_[0].value()};
}

void FixedWing::step(double seconds, double lateral_mps2) {
  const double wanted = std::clamp(std::atan2(lateral_mps2, kStandardGravity_mps2), -kMaxBank_rad, kMaxBank_rad);
  const double most = kMaxRollRate_rad_s * seconds;
  bank_rad_ += std::clamp((wanted - bank_rad_) * std::min(1.0, seconds / kBankTime_s), -most, most);
  heading_rad_ = wrap_pi(heading_rad_ + kStandardGravity_mps2 * std::tan(bank_rad_) / airspeed_mps_ * seconds);
  for (GaussMarkovProcess& process : gusts_) process.step(seconds, random_);
  for (GaussMarkovProcess& process : shake_) process.step(seconds, random_);
  const Eigen::Vector2d before = velocity_;
  velocity_ = air_velocity_mps() + wind_ + Eigen::Vector2d(gusts_[0].value(), gusts_[1].value());
  acceleration_ = (velocity_ - before) / seconds;
  position_ += (velocity_ + before) / 2 * seconds;
  const Attitude last = attitude_;
  attitude_ = shaken();
  rates_ = camera_rate(last, attitude_, seconds);
  turned_ += seconds * rates_;
  pulled_ += seconds * specific_force_mps2();
  since_s_ += seconds;
}

FixedWing::Inertial FixedWing::take_inertial() {
  if (!(since_s_ > 0)) return {rates_, specific_force_mps2()};
  const Inertial mean{turned_ / since_s_, pulled_ / since_s_};
  turned_.setZero();
  pulled_.setZero();
  since_s_ = 0;
  return mean;
}

Eigen::Vector3d FixedWing::specific_force_mps2() const {
  const Eigen::Vector3d ned(acceleration_.y(), acceleration_.x(), -kStandardGravity_mps2);
  const Eigen::Quaterniond body = Eigen::AngleAxisd(attitude_.heading_rad, Eigen::Vector3d::UnitZ()) *
                                  Eigen::AngleAxisd(attitude_.pitch_rad, Eigen::Vector3d::UnitY()) *
                                  Eigen::AngleAxisd(attitude_.roll_rad, Eigen::Vector3d::UnitX());
  return body.conjugate() * ned;
}

}  // namespace nadir
