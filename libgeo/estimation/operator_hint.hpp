// "You should be about there", said by an operator to an aircraft that is lost. A place to look at first, carried along
// by odometry and vaguer with every step; never a position: only the map may confirm it.
#pragma once

#include <Eigen/Core>
#include <optional>

#include "geodesy/region.hpp"

namespace nadir {

class OperatorHint {
 public:
  // Where the aircraft is said to be, in the map's plane, and how far off that may be.
  OperatorHint(const Eigen::Vector2d& at_m, double radius_m) : at_m_(at_m), radius_m_(radius_m) {}

  // From the first frame after the hint on: what the filter believes then is what carries the hint.
  void carried_from(const Eigen::Vector2d& position_m, double sigma_m);
  bool carried() const { return from_m_.has_value(); }

  const Eigen::Vector2d& at_m() const { return at_m_; }
  double radius_m() const { return radius_m_; }

  // Where to look now; nothing when that lies wholly outside of the area. sigma_m: of the position, one axis.
  std::optional<PlaneBox> box(const Eigen::Vector2d& position_m, double sigma_m,
                              const std::optional<PlaneBox>& area) const;

 private:
  Eigen::Vector2d at_m_;
  double radius_m_;
  std::optional<Eigen::Vector2d> from_m_;
  double from_sigma_m_ = 0;
};

}  // namespace nadir
