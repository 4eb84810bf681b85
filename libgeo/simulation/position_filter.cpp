#include "simulation/position_filter.hpp"

#include <algorithm>
#include <cmath>

namespace nadir {
namespace {

constexpr double kAccelerationNoise = 0.35, kRememberedWind_mps = 1.5, kLeastVelocitySigma_mps = 0.3;
constexpr double kWindLearned = 0.02, kAirspeedHeld = 0.2;  // shares at each hold_airspeed()

}  // namespace

PositionFilter::PositionFilter(PlanePoint place, const Eigen::Vector2d& velocity_mps)
    : position_(place.vector()), velocity_(velocity_mps) {}

double PositionFilter::sigma_m() const { return std::sqrt(pp_); }

void PositionFilter::predict(double seconds, const Eigen::Vector2d& acceleration_mps2) {
  position_ += velocity_ * seconds + acceleration_mps2 * (seconds * seconds / 2);
  velocity_ += acceleration_mps2 * seconds;
  pp_ += 2 * seconds * pv_ + seconds * seconds * vv_;
  pv_ += seconds * vv_;
  vv_ += kAccelerationNoise * kAccelerationNoise * seconds;
}

void PositionFilter::hold_airspeed(const Eigen::Vector2d& air_velocity_mps, bool aided) {
  if (aided) {
    wind_ += kWindLearned * (velocity_ - air_velocity_mps - wind_);
    return;
  }
  velocity_ += kAirspeedHeld * (air_velocity_mps + wind_ - velocity_);
  vv_ = std::min(vv_, kRememberedWind_mps * kRememberedWind_mps);
  pv_ = std::min(pv_, std::sqrt(pp_ * vv_));
}

bool PositionFilter::fuse(PlanePoint place, double sigma_m, double gate) {
  const Eigen::Vector2d innovation = place.vector() - position_;
  const double s = pp_ + sigma_m * sigma_m;
  if (innovation.cwiseAbs2().maxCoeff() > gate * gate * s) return false;
  const double gain_p = pp_ / s, gain_v = pv_ / s;
  position_ += gain_p * innovation;
  velocity_ += gain_v * innovation;
  vv_ -= gain_v * pv_;
  pv_ -= gain_p * pv_;
  pp_ -= gain_p * pp_;
  return true;
}

void PositionFilter::fuse_velocity(const Eigen::Vector2d& velocity_mps, double sigma_mps) {
  const double sigma = std::max(kLeastVelocitySigma_mps, sigma_mps), s = vv_ + sigma * sigma;
  const Eigen::Vector2d innovation = velocity_mps - velocity_;
  const double gain_p = pv_ / s, gain_v = vv_ / s;
  position_ += gain_p * innovation;
  velocity_ += gain_v * innovation;
  pp_ -= gain_p * pv_;
  pv_ -= gain_v * pv_;
  vv_ -= gain_v * vv_;
}

void PositionFilter::reset(PlanePoint place, double sigma_m) {
  position_ = place.vector();
  pp_ = sigma_m * sigma_m;
  pv_ = 0;
}

}  // namespace nadir
