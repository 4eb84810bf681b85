#include "camera/backlog_guard.hpp"

#include <algorithm>
#include <cmath>

namespace nadir {
namespace {

constexpr double kShortestPause_s = 0.5;
constexpr double kPauseInIntervals = 2.5;  // a single missing frame is not a pause: cameras jitter
constexpr double kFastInIntervals = 0.75;
constexpr std::size_t kMinIntervals = 3;

}  // namespace

// The median; nullopt until enough intervals are measured.
std::optional<double> BacklogGuard::usual_interval_s() const {
  if (measured_ < kMinIntervals) return std::nullopt;
  auto sorted = intervals_s_;
  const auto end = sorted.begin() + static_cast<std::ptrdiff_t>(std::min(measured_, kKept));
  const auto middle = sorted.begin() + (end - sorted.begin()) / 2;
  std::nth_element(sorted.begin(), middle, end);
  return *middle;
}

BacklogGuard::Verdict BacklogGuard::classify(double arrived_s) {
  if (!std::isfinite(arrived_s)) return Verdict::fresh;
  const double interval_s = last_s_ ? arrived_s - *last_s_ : -1;
  last_s_ = arrived_s;
  if (interval_s < 0) {  // the first one, or time ran backwards
    state_ = State::steady;
    return Verdict::fresh;
  }
  return state_ == State::steady ? steady(interval_s) : after_pause(interval_s);
}

BacklogGuard::Verdict BacklogGuard::steady(double interval_s) {
  const auto usual = usual_interval_s();
  intervals_s_[measured_++ % kKept] = interval_s;  // also that of a pause: the camera may have become slower for good
  if (usual && interval_s > std::max(kShortestPause_s, kPauseInIntervals * *usual)) {
    state_ = State::holding;
    interval_before_s_ = *usual;
    backlog_s_ = interval_s - *usual;
    return Verdict::hold;
  }
  return Verdict::fresh;
}

BacklogGuard::Verdict BacklogGuard::after_pause(double interval_s) {
  backlog_s_ -= interval_before_s_ - interval_s;
  if (interval_s < kFastInIntervals * interval_before_s_ && backlog_s_ > 0) {
    state_ = State::draining;
    return Verdict::stale;
  }
  state_ = State::steady;
  return steady(interval_s);
}

std::optional<double> BacklogGuard::settled_s() const {
  if (state_ != State::holding) return std::nullopt;
  return *last_s_ + kFastInIntervals * interval_before_s_;
}

}  // namespace nadir
