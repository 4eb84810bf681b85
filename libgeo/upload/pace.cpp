#include "upload/pace.hpp"

#include <algorithm>
#include <chrono>
#include <thread>

namespace nadir {

std::int64_t SystemPace::now_ms() const {
  using namespace std::chrono;
  return duration_cast<milliseconds>(system_clock::now().time_since_epoch()).count();
}

// By the steady clock: a clock that is set while we wait must not make us wait for years.
void SystemPace::wait(std::int64_t duration_ms, const std::function<void()>& check) {
  using namespace std::chrono;
  const auto end = steady_clock::now() + milliseconds(duration_ms);
  for (;;) {
    check();
    const auto left = end - steady_clock::now();
    if (left <= steady_clock::duration::zero()) return;
    std::this_thread::sleep_for(std::min<steady_clock::duration>(left, milliseconds(200)));
  }
}

}  // namespace nadir
