// Detects stale frames. A camera, network or disk that stalls may deliver its buffer afterwards, and each of those
// frames is as old as the stall was long. A frame does not show this; only the frame interval does:
//
//   after a pause                  the first frame may have been captured at any time of it: it is unproven
//   while frames arrive too fast   they were captured before: they are stale …
//   until                          one arrives at the usual interval, or the backlog of the pause is used up
//
// One frame is enough to mislead: it shows where the aircraft was, and the motion from it to the next one looks like a
// turn or a halt. An unproven frame is therefore not used, even when no other follows.
//
// Undetectable: a stall shorter than the threshold of a pause, a source that drains its backlog hardly faster than it
// captures, or one that stays late for good (docs/onboard.md). Times are monotonic seconds, given by the caller.
#pragma once

#include <array>
#include <cstddef>
#include <optional>

namespace nadir {

class BacklogGuard {
 public:
  enum class Verdict {
    fresh,
    unproven,  // the first one after a pause
    stale,
  };

  // Classifies a frame.
  Verdict classify(double arrived_s);

 private:
  Verdict steady(double interval_s);
  Verdict after_pause(double interval_s);
  std::optional<double> usual_interval_s() const;

  static constexpr std::size_t kKept = 15;

  bool after_pause_ = false;
  std::optional<double> last_s_;
  // The usual interval before the pause, and how much backlog may still follow.
  double interval_before_s_ = 0, backlog_s_ = 0;
  double last_interval_s_ = 0;
  std::array<double, kKept> intervals_s_{};  // without those of stale frames
  std::size_t measured_ = 0;
};

}  // namespace nadir
