// Which pictures are of now? A camera, a network or a disk that stalls may hand out afterwards what it had held back,
// and each such picture is as old as the stall was long. Nothing in a picture says so. What can be told from outside is
// the pace: after a pause, pictures that come quicker than the camera takes them were taken before.
//
//   after a pause   the first picture is held until the next one would be due: comes another before, both are old
//   while they come quicker than usual   they are old …
//   until   one comes at the usual pace, or as many came as the pause can have held back
//
// What cannot be told: a stall shorter than that of a pause, a source that hands out its backlog hardly quicker than it
// takes pictures, or that stays late for good (docs/onboard.md). Times are monotonic seconds, given by the caller.
#pragma once

#include <array>
#include <cstddef>
#include <optional>

namespace nadir {

class BacklogGuard {
 public:
  enum class Verdict {
    fresh,
    wait,   // not known yet: hold it; it is fresh when no other has come until settled_s()
    stale,  // and so is the one that is held
  };

  // A picture has come.
  Verdict judge(double arrived_s);

  // While one is held: from then on it is fresh.
  std::optional<double> settled_s() const;

 private:
  enum class State { steady, holding, draining };

  Verdict steady(double interval_s);
  Verdict after_pause(double interval_s);
  std::optional<double> usual_s() const;

  static constexpr std::size_t kKept = 15;

  State state_ = State::steady;
  std::optional<double> last_s_;
  // Of the pause: the camera's interval before it, and what may still have been held back.
  double interval_before_s_ = 0, owed_s_ = 0;
  std::array<double, kKept> intervals_s_{};  // but those of stale pictures
  std::size_t measured_ = 0;
};

}  // namespace nadir
