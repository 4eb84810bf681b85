// A clock that stands still until a test advances it.
#pragma once

#include <condition_variable>
#include <mutex>
#include <utility>

#include "service/clock.hpp"

namespace nadir {

class ManualClock final : public FlightClock {
 public:
  explicit ManualClock(double monotonic_s = 1000, std::int64_t unix_us = 1'750'000'000'000'000,
                       std::string boot_id = "boot-1")
      : now_s_(monotonic_s), unix_us_(unix_us), boot_id_(std::move(boot_id)) {}

  void advance(double seconds) {
    {
      const std::scoped_lock lock(mutex_);
      now_s_ += seconds;
      unix_us_ += static_cast<std::int64_t>(seconds * 1e6);
    }
    moved_.notify_all();
  }

  // The system clock is set; monotonic time does not change.
  void step_utc(double seconds) {
    const std::scoped_lock lock(mutex_);
    unix_us_ += static_cast<std::int64_t>(seconds * 1e6);
  }

  double monotonic_s() const override {
    const std::scoped_lock lock(mutex_);
    return now_s_;
  }
  std::int64_t unix_us() const override {
    const std::scoped_lock lock(mutex_);
    return unix_us_;
  }
  const std::string& boot_id() const override { return boot_id_; }

  bool wait_until(double until_s, std::stop_token stop) const override {
    std::unique_lock lock(mutex_);
    return moved_.wait(lock, stop, [&] { return now_s_ >= until_s; }) && !stop.stop_requested();
  }

 private:
  mutable std::mutex mutex_;
  mutable std::condition_variable_any moved_;
  double now_s_;
  std::int64_t unix_us_;
  std::string boot_id_;
};

}  // namespace nadir
