// Where on the map a frame is searched.
//
// With a prediction: a square of 3 σ around it, within limits; it grows while frames match nowhere in it, because that
// contradicts the prediction. Until the first anchor 5 σ: a chance peak must not be alone with a start that is far off.
// Without a prediction (lost): the part of the mission's area within 3 σ of the position, by suggestions first (an
// operator's hint, the place index), else in parts of limited size, one for each frame.
#pragma once

#include <optional>
#include <utility>

#include "estimation/estimate.hpp"
#include "geodesy/region.hpp"
#include "vision/map_matcher.hpp"

namespace nadir {

class SearchWindow {
 public:
  // Half sides of the square; area: where the flight can be at all.
  SearchWindow(double min_radius_m, double max_radius_m, const std::optional<PlaneBox>& area)
      : min_radius_m_(min_radius_m), max_radius_m_(max_radius_m), area_(area) {}

  void record_attempt(AnchorVerdict verdict);

  // Half the side. position_sigma_m: one axis.
  double radius_m(double position_sigma_m) const;
  // No window around the prediction is certain to contain the place. placed: a position is known at all.
  bool lost(bool placed, double position_sigma_m) const;
  // The parts of an area that is too large to be searched for every frame, one each time, nearest to the position
  // first.
  PlaneBox next_part(const PlaneBox& area, PlanePoint position);
  // The part of the area that the aircraft can be in. The area must be known.
  PlaneBox reachable_area(bool placed, PlanePoint position, double position_sigma_m) const;

 private:
  double min_radius_m_, max_radius_m_;
  std::optional<PlaneBox> area_;
  bool anchored_ = false;
  int failures_ = 0;       // over the map, since the last anchor
  std::size_t parts_ = 0;  // handed out since the last anchor
};

// A position that an operator gives to an aircraft that is lost: where to search first, moved along by odometry, its
// radius growing with the position's σ. Never a position fix: only the map may confirm it.
class OperatorHint {
 public:
  // In the map's plane.
  OperatorHint(PlanePoint at, double radius_m) : at_(at), radius_m_(radius_m) {}

  // From the first frame after the hint on the filter's position propagates the hint.
  void start_propagation(PlanePoint position, double sigma_m);
  bool propagating() const { return from_.has_value(); }
  // Whether the belief has still to weigh it; it does so once.
  bool begin_weighing() { return !std::exchange(weighed_, true); }

  PlanePoint at() const { return at_; }
  double radius_m() const { return radius_m_; }

  // Where to search now; nothing when that lies wholly outside the area. sigma_m: of the position, one axis.
  std::optional<PlaneBox> box(PlanePoint position, double sigma_m, const std::optional<PlaneBox>& area) const;

 private:
  PlanePoint at_;
  double radius_m_;
  std::optional<PlanePoint> from_;
  double from_sigma_m_ = 0;
  bool weighed_ = false;
};

// Where a lost aircraft is searched: chosen with the frame, searched by its job.
struct LostSearch {
  PlaneBox area;
  std::optional<PlaneBox> hint;
  PlaneBox part;  // of the area, to be searched when suggestions fail
};

// places: the package's index; null: there is none.
AnchorMatch match_lost(MapMatcher& matcher, const PlaceRetrieval* places, const cv::Mat& grey, const AnchorPrior& prior,
                       const LostSearch& where);

}  // namespace nadir
