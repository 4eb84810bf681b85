#include "service/clock.hpp"

#include <algorithm>
#include <chrono>
#include <condition_variable>
#include <ctime>
#include <fstream>
#include <mutex>

namespace nadir {
namespace {

constexpr double kLongestWait_s = 3600;  // per wait: keeps sums of durations far from overflow

std::string read_boot_id() {
  std::string id;
  std::ifstream("/proc/sys/kernel/random/boot_id") >> id;
  return id;
}

}  // namespace

SystemFlightClock::SystemFlightClock() : boot_id_(read_boot_id()) {}

double SystemFlightClock::monotonic_s() const {
  std::timespec time{};
  ::clock_gettime(CLOCK_BOOTTIME, &time);
  return static_cast<double>(time.tv_sec) + 1e-9 * static_cast<double>(time.tv_nsec);
}

std::int64_t SystemFlightClock::unix_us() const {
  using namespace std::chrono;
  return duration_cast<microseconds>(system_clock::now().time_since_epoch()).count();
}

bool SystemFlightClock::wait_until(double until_s, std::stop_token stop) const {
  std::mutex mutex;
  std::condition_variable_any never;  // never notified: only time and stop end the wait
  std::unique_lock lock(mutex);
  while (!stop.stop_requested()) {
    const double left_s = until_s - monotonic_s();
    if (!(left_s > 0)) return true;
    const std::chrono::duration<double> wait(std::min(left_s, kLongestWait_s));
    never.wait_for(lock, stop, std::chrono::ceil<std::chrono::microseconds>(wait), [] { return false; });
  }
  return false;
}

}  // namespace nadir
