#include "upload/back_off.hpp"

#include <algorithm>

namespace nadir {

std::int64_t back_off_ms(int failures_before, std::optional<std::int64_t> retry_after_s, Random& random) {
  constexpr std::int64_t kDay_s = 86'400;
  if (retry_after_s) return std::clamp<std::int64_t>(*retry_after_s, 0, kDay_s) * 1'000;
  const int doublings = std::clamp(failures_before, 0, 20);
  const std::int64_t limit_ms = std::min(kLongestBackOff_ms, kFirstBackOff_ms << doublings);
  return static_cast<std::int64_t>(random.uniform() * static_cast<double>(limit_ms));
}

}  // namespace nadir
