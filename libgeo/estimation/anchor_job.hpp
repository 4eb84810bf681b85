// One look at the map for one frame: what is believed at that moment, kept while the flight goes on, and what was
// found.
#pragma once

#include <functional>
#include <optional>

#include "estimation/anchor_gates.hpp"
#include "estimation/flight_filter.hpp"

namespace nadir {

class AnchorJob {
 public:
  // The heavy part, 0.1 s to some seconds. On any thread; the localizer hands out one job at a time.
  // Where `cancel` ends it, or the look fails, it throws and the job is one that never ran.
  void run(const Cancel& cancel = {}) { match = look(cancel); }

  // The rest is the localizer's own.
  std::function<AnchorMatch(const Cancel&)> look;
  std::optional<AnchorMatch> match;  // once it has run

  std::size_t step = 0;  // of the flight's log
  double time_s = 0;
  double measured_agl_m = 0;
  Eigen::Vector2d measured_tilt_rad = Eigen::Vector2d::Zero();
  FlightFilter flight;  // as it was
  AnchorPrior prior;
  Prediction prediction;
  bool everywhere = false;  // it has no prediction and no hint: it searches all of the area, for half a minute perhaps
};

}  // namespace nadir
