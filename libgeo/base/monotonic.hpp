// A clock that never goes back, for limits on how long something may take. Tests pass one of their own.
#pragma once

#include <chrono>
#include <cstdint>
#include <functional>

namespace nadir {

using MonotonicMs = std::function<std::int64_t()>;

inline std::int64_t steady_clock_ms() {
  using namespace std::chrono;
  return duration_cast<milliseconds>(steady_clock::now().time_since_epoch()).count();
}

}  // namespace nadir
