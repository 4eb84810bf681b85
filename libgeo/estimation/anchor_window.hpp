// Where on the map a frame is searched: around the prediction as far as it may be off, farther after frames that fitted
// nowhere near it, and in all of the area when there is no prediction.
#pragma once

#include <Eigen/Core>
#include <optional>

#include "estimation/localizer.hpp"

namespace nadir {

class AnchorWindow {
 public:
  explicit AnchorWindow(const LocalizerConfig& config)
      : min_radius_m_(config.min_search_radius_m), max_radius_m_(config.max_search_radius_m), area_(config.area) {}

  // Frames that fit nowhere near the prediction speak against it: the window grows, until it holds the place.
  void attempted(AnchorVerdict verdict);

  // position_sigma_m: one axis. placed: a position is known at all.
  double radius_m(double position_sigma_m) const;
  bool lost(bool placed, double position_sigma_m) const;  // no window of a search with a prior surely holds the place
  // The squares of an area that is too large to be searched for every frame, one each time it is asked, nearest to the
  // prediction first.
  PlaneBox next_part(const PlaneBox& area, const Eigen::Vector2d& position_m);
  // What of the area the aircraft can be in. The area must be known.
  PlaneBox area_left(bool placed, const Eigen::Vector2d& position_m, double position_sigma_m) const;

 private:
  double min_radius_m_, max_radius_m_;
  std::optional<PlaneBox> area_;
  int failures_ = 0;       // over the map, since the last anchor
  std::size_t parts_ = 0;  // asked for since the last anchor
};

}  // namespace nadir
