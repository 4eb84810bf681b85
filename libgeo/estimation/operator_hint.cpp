#include "estimation/operator_hint.hpp"

#include <algorithm>
#include <cmath>

namespace nadir {
namespace {

constexpr double kLeastReach_m = 100;  // so that other places compete
constexpr double kReachSigmas = 3;

}  // namespace

void OperatorHint::carried_from(const Eigen::Vector2d& position_m, double sigma_m) {
  from_m_ = position_m;
  from_sigma_m_ = sigma_m;
}

std::optional<PlaneBox> OperatorHint::box(const Eigen::Vector2d& position_m, double sigma_m,
                                          const std::optional<PlaneBox>& area) const {
  const Eigen::Vector2d at = from_m_ ? Eigen::Vector2d(at_m_ + position_m - *from_m_) : at_m_;
  const double grown = from_m_ ? std::max(0.0, sigma_m * sigma_m - from_sigma_m_ * from_sigma_m_) : 0.0;
  const double reach_m = std::max(kLeastReach_m, radius_m_) + kReachSigmas * std::sqrt(grown);
  PlaneBox box{at.x() - reach_m, at.y() - reach_m, at.x() + reach_m, at.y() + reach_m};
  if (!area) return box;
  box = {std::max(box.west_m, area->west_m), std::max(box.south_m, area->south_m), std::min(box.east_m, area->east_m),
         std::min(box.north_m, area->north_m)};
  if (box.west_m >= box.east_m || box.south_m >= box.north_m) return std::nullopt;
  return box;
}

}  // namespace nadir
