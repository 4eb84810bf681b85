// Something that is due every so often: fixes at 10 Hz, status at 1 Hz, the state on disk at 1 Hz.
//
// Due times lie on a grid, so that a late turn does not move the following ones; after a long stall it is due once,
// never in a burst that makes up for the past.
#pragma once

#include <cmath>

namespace nadir {

class Cadence {
 public:
  Cadence(double period_s, double first_s) : period_s_(period_s), next_s_(first_s) {}

  double next_s() const { return next_s_; }

  // Whether it is due now; the next time is then set.
  bool due(double now_s) {
    if (now_s < next_s_) return false;
    next_s_ += period_s_ * (std::floor((now_s - next_s_) / period_s_) + 1);
    if (next_s_ <= now_s) next_s_ += period_s_;  // rounding
    return true;
  }

 private:
  double period_s_;
  double next_s_;
};

}  // namespace nadir
