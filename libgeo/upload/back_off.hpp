// How long to wait before trying again: a random time up to a limit that doubles with each failure, so that many
// senders who failed together do not come back together. What the service asks for goes first.
#pragma once

#include <cstdint>
#include <optional>

#include "base/random.hpp"

namespace nadir {

inline constexpr std::int64_t kFirstBackOff_ms = 2'000;
inline constexpr std::int64_t kLongestBackOff_ms = 15 * 60 * 1'000;

// random(0, min(15 min, 2 s · 2ⁿ)), n the failures before this one; or the service's Retry-After (at most a day).
std::int64_t back_off_ms(int failures_before, std::optional<std::int64_t> retry_after_s, Random& random);

}  // namespace nadir
