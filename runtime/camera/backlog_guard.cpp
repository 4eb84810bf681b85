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
    after_pause_ = false;
    return Verdict::fresh;
  }
  return after_pause_ ? after_pause(interval_s) : steady(interval_s);
}

// An interval that is as long as the one before it is no pause: the camera has become slower.
BacklogGuard::Verdict BacklogGuard::steady(double interval_s) {
  const auto usual = usual_interval_s();
  const double longest_s = usual ? kPauseInIntervals * std::max(*usual, last_interval_s_) : 0;
  intervals_s_[measured_++ % kKept] = last_interval_s_ = interval_s;  // also that of a pause
  if (!usual || interval_s <= std::max(kShortestPause_s, longest_s)) return Verdict::fresh;
  after_pause_ = true;
  interval_before_s_ = *usual;
  backlog_s_ = interval_s - *usual;
  return Verdict::unproven;
}

BacklogGuard::Verdict BacklogGuard::after_pause(double interval_s) {
  backlog_s_ -= interval_before_s_ - interval_s;
  if (interval_s < kFastInIntervals * interval_before_s_ && backlog_s_ > 0) {
    last_interval_s_ = interval_s;
    return Verdict::stale;
  }
  after_pause_ = false;
  return steady(interval_s);
}

}  // namespace nadir
