#include "estimation/anchor_window.hpp"

#include <algorithm>

namespace nadir {
namespace {

constexpr int kFailuresPerRing = 3, kMostRings = 4;
constexpr double kReachSigmas = 3;

}  // namespace

void AnchorWindow::attempted(AnchorVerdict verdict) {
  if (verdict == AnchorVerdict::accepted) {
    failures_ = 0;
  } else if (verdict != AnchorVerdict::no_map) {
    ++failures_;
  }
}

double AnchorWindow::radius_m(double position_sigma_m) const {
  const double least_m = min_radius_m_ * (1 + std::min(failures_ / kFailuresPerRing, kMostRings));
  return std::clamp(kReachSigmas * position_sigma_m, least_m, std::max(least_m, max_radius_m_));
}

bool AnchorWindow::lost(bool placed, double position_sigma_m) const {
  return !placed || (area_ && kReachSigmas * position_sigma_m > max_radius_m_);
}

PlaneBox AnchorWindow::area_left(bool placed, const Eigen::Vector2d& position_m, double position_sigma_m) const {
  if (!placed) return *area_;
  const double reach_m = kReachSigmas * position_sigma_m;
  const PlaneBox both{
      std::max(area_->west_m, position_m.x() - reach_m), std::max(area_->south_m, position_m.y() - reach_m),
      std::min(area_->east_m, position_m.x() + reach_m), std::min(area_->north_m, position_m.y() + reach_m)};
  return both.west_m < both.east_m && both.south_m < both.north_m ? both : *area_;
}

}  // namespace nadir
