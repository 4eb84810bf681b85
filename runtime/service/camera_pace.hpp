// How often this camera gives pictures, measured from the pictures: so that a camera that is slow, or that does not
// keep time, is not called silent between two of them, and a fast one is called silent at once.
//
// Of the last intervals the median is what the camera does when all is well, and the tenth decile how late a picture
// may come all the same. Pictures that come together count as one; a gap in which the camera was silent is one interval
// among many. Times are monotonic seconds, given by the caller.
#pragma once

#include <array>
#include <cstddef>
#include <optional>

namespace nadir {

class CameraPace {
 public:
  // first_guess_s: the interval until enough have been measured.
  explicit CameraPace(double first_guess_s) : first_guess_s_(first_guess_s) {}

  void picture(double time_s);

  // So long after a picture the next one is missing: 400 ms, with slow cameras 1.2 intervals. Where pictures come
  // unevenly more, but never more than two intervals: then a whole picture is missing.
  double silence_limit_s() const;

 private:
  static constexpr std::size_t kKept = 16;  // 5 s at 3 Hz

  double first_guess_s_;
  std::optional<double> last_s_;  // the picture from which the interval counts
  std::array<double, kKept> intervals_s_{};
  std::size_t measured_ = 0;
};

}  // namespace nadir
