// Detects stale frames. A camera, network or disk that stalls may deliver its buffer afterwards, and each of those
// frames is as old as the stall was long. A frame does not show this; only the frame interval does: after a pause,
// frames that arrive faster than the camera captures them were captured before.
//
//   after a pause                  the first frame is held until the next one would be due: if another arrives earlier,
//                                  both are stale
//   while frames arrive too fast   they are stale …
//   until                          one arrives at the usual interval, or the backlog of the pause is used up
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
    hold,   // undecided: keep it; it is fresh when no other arrives until settled_s()
    stale,  // and so is the held one
  };

  // Classifies a frame.
  Verdict classify(double arrived_s);

  // While a frame is held: the time from which it counts as fresh.
  std::optional<double> settled_s() const;

 private:
  enum class State { steady, holding, draining };

  Verdict steady(double interval_s);
  Verdict after_pause(double interval_s);
  std::optional<double> usual_interval_s() const;

  static constexpr std::size_t kKept = 15;

  State state_ = State::steady;
  std::optional<double> last_s_;
  // The usual interval before the pause, and how much backlog may still follow.
  double interval_before_s_ = 0, backlog_s_ = 0;
  std::array<double, kKept> intervals_s_{};  // without those of stale frames
  std::size_t measured_ = 0;
};

}  // namespace nadir
