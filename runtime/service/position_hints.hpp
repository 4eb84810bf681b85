// Position hints of people: how often one is taken, and when the operator is asked for one.
//
// A hint says where to search first. It is never a position: only a match with the map is.
#pragma once

#include <optional>

namespace nadir {

// Each hint may cancel a search: a sender in a loop must not prevent the localizer from finishing one. One every
// kHintPeriod_s on average, kHintBurst at once after a pause. Times are monotonic seconds.
class HintAllowance {
 public:
  HintAllowance();

  bool take(double now_s);  // false: not now, the last hint still applies

 private:
  double credit_;  // hints that may come now, as of …
  double credit_s_ = 0;
};

// Armed, and for kAskForHint_s there was no position, neither ours nor that of a trusted GPS: a person who sees the
// camera's pictures, or knows the route, may know better. Again after kAskForHintAgain_s, until there is a position.
class HintRequest {
 public:
  // Whether to ask now.
  bool due(double now_s, bool armed, bool has_position);

 private:
  std::optional<double> lost_since_s_, asked_s_;
};

}  // namespace nadir
