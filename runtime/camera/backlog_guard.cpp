#include "camera/backlog_guard.hpp"

#include <algorithm>
#include <cmath>

namespace nadir {
namespace {

constexpr double kShortestPause_s = 0.5;
constexpr double kPauseInIntervals = 2.5;  // one missing picture is none yet: cameras do not keep time so well
constexpr double kQuickInIntervals = 0.75;
constexpr std::size_t kEnough = 3;  // intervals

}  // namespace

// The median; nothing while too little is known of the camera.
std::optional<double> BacklogGuard::usual_s() const {
  if (measured_ < kEnough) return std::nullopt;
  auto sorted = intervals_s_;
  const auto end = sorted.begin() + static_cast<std::ptrdiff_t>(std::min(measured_, kKept));
  const auto middle = sorted.begin() + (end - sorted.begin()) / 2;
  std::nth_element(sorted.begin(), middle, end);
  return *middle;
}

BacklogGuard::Verdict BacklogGuard::judge(double arrived_s) {
  if (!std::isfinite(arrived_s)) return Verdict::fresh;
  const double interval_s = last_s_ ? arrived_s - *last_s_ : -1;
  last_s_ = arrived_s;
  if (interval_s < 0) {  // the first one, or time that runs backwards
    state_ = State::steady;
    return Verdict::fresh;
  }
  return state_ == State::steady ? steady(interval_s) : after_pause(interval_s);
}

BacklogGuard::Verdict BacklogGuard::steady(double interval_s) {
  const auto usual = usual_s();
  intervals_s_[measured_++ % kKept] = interval_s;  // of a pause as well: the camera may have become slower for good
  if (usual && interval_s > std::max(kShortestPause_s, kPauseInIntervals * *usual)) {
    state_ = State::holding;
    interval_before_s_ = *usual;
    owed_s_ = interval_s - *usual;
    return Verdict::wait;
  }
  return Verdict::fresh;
}

BacklogGuard::Verdict BacklogGuard::after_pause(double interval_s) {
  owed_s_ -= interval_before_s_ - interval_s;
  if (interval_s < kQuickInIntervals * interval_before_s_ && owed_s_ > 0) {
    state_ = State::draining;
    return Verdict::stale;
  }
  state_ = State::steady;
  return steady(interval_s);
}

std::optional<double> BacklogGuard::settled_s() const {
  if (state_ != State::holding) return std::nullopt;
  return *last_s_ + kQuickInIntervals * interval_before_s_;
}

}  // namespace nadir
