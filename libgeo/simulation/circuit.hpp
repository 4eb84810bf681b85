// A closed track: waypoints with rounded corners, as points every few metres.
#pragma once

#include <cstddef>
#include <optional>
#include <span>
#include <vector>

#include "geodesy/plane_point.hpp"

namespace nadir {

class Circuit {
 public:
  // turn_radius_m: of the corners; smaller where the legs are too short for it. Throws UsageError for fewer than three
  // corners, or two at one place.
  Circuit(std::span<const PlanePoint> corners, double turn_radius_m);

  PlanePoint point(std::ptrdiff_t index) const;  // any index: it goes round
  double heading_rad(std::ptrdiff_t index) const;
  double length_m() const;
  // Of the corners. An aircraft that cannot turn so tightly leaves the track there.
  double tightest_turn_m() const { return tightest_turn_m_; }

  // near: where it was last. Only when it is not near there any more, all of the track is searched.
  std::ptrdiff_t nearest(PlanePoint place, std::optional<std::ptrdiff_t> near) const;
  // From the track beside its nearest point.
  double off_track_m(PlanePoint place, std::ptrdiff_t nearest) const;

  static constexpr double kSpacing_m = 4;

 private:
  std::vector<PlanePoint> points_;
  double tightest_turn_m_ = 0;
};

}  // namespace nadir
