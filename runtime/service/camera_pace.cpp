#include "service/camera_pace.hpp"

#include <algorithm>
#include <cmath>

#include "service/service_rules.hpp"

namespace nadir {
namespace {

constexpr double kTogether_s = 0.1;  // closer pictures are a burst, or a camera so fast that the 400 ms decide
constexpr double kSlowest_s = 2.5;   // whatever comes more rarely is no camera to fly by
constexpr std::size_t kEnough = 3;   // intervals

}  // namespace

void CameraPace::picture(double time_s) {
  if (!std::isfinite(time_s)) return;
  if (!last_s_) last_s_ = time_s;
  const double interval_s = time_s - *last_s_;
  if (interval_s < kTogether_s) return;
  intervals_s_[measured_++ % kKept] = std::min(interval_s, kSlowest_s);
  last_s_ = time_s;
}

double CameraPace::silence_limit_s() const {
  double usual_s = first_guess_s_, late_s = first_guess_s_;
  if (measured_ >= kEnough) {
    auto sorted = intervals_s_;
    const auto end = sorted.begin() + static_cast<std::ptrdiff_t>(std::min(measured_, kKept));
    std::sort(sorted.begin(), end);
    const auto last = end - sorted.begin() - 1;
    usual_s = sorted[static_cast<std::size_t>(last / 2)];
    late_s = sorted[static_cast<std::size_t>((9 * last + 9) / 10)];
  }
  return std::max(kBlackout_s, std::min(kMissedFrames * late_s, kLatestInIntervals * usual_s));
}

}  // namespace nadir
