// Whether the position may be used for what the mission demands: its protection level (estimation/belief.hpp) is within
// the alert limit; and when the operator is told.
//
//   usable      within the limit, and no alert stands
//   alert       the level left the limit half the time to alert ago, and is beyond it now. Half: frame, estimate and
//               message take their part of the rest. An excursion that is over sooner is no alert; but it counts on
//               until the level was within the limit for the time to alert, so that a level that flickers is one
//   alert ends  the level was within the limit for the time to alert without a break
//
// Times are monotonic seconds and come from outside.
#pragma once

#include <optional>

namespace nadir {

class PositionUsability {
 public:
  PositionUsability(double alert_limit_m, double time_to_alert_s)
      : alert_limit_m_(alert_limit_m), time_to_alert_s_(time_to_alert_s) {}

  enum class Change { none, lost, regained };

  // hpl_m: of the position now; nothing: there is no position, or no radius is known to hold it.
  Change update(double now_s, const std::optional<double>& hpl_m);

  bool usable() const { return within_since_s_ && !alerted_; }

 private:
  double alert_limit_m_, time_to_alert_s_;
  std::optional<double> left_s_;          // when the level left the limit, and has not been within it for long
  std::optional<double> within_since_s_;  // without a break; nothing: it is beyond
  bool alerted_ = false;
};

}  // namespace nadir
