// Who still lives: each thread beats, and who has been silent for longer than it may is named.
//
// A beat is one store to an atomic; it never waits. A thread whose beat is destroyed has ended in order and is watched
// no more; one that ended by an exception must end the service.
#pragma once

#include <atomic>
#include <list>
#include <memory>
#include <mutex>
#include <string>
#include <utility>
#include <vector>

#include "service/clock.hpp"

namespace nadir {

struct LateThread {
  std::string name;
  double silent_s = 0;
  double limit_s = 0;

  std::string text() const;  // "localizer silent for 3.2 s (at most 2 s)"
};

class ThreadWatch {
  struct Watched {
    std::string name;
    double limit_s;
    std::atomic<double> last_s;
    std::atomic<bool> ended{false};
  };

 public:
  // What a thread holds. Movable; must not outlive the clock.
  class Beat {
   public:
    Beat(Beat&& other) noexcept = default;
    Beat& operator=(Beat&&) = delete;
    ~Beat() {
      if (watched_) watched_->ended.store(true);
    }

    void operator()() { watched_->last_s.store(clock_->monotonic_s()); }

   private:
    friend class ThreadWatch;
    Beat(std::shared_ptr<Watched> watched, const FlightClock& clock) : watched_(std::move(watched)), clock_(&clock) {}

    std::shared_ptr<Watched> watched_;
    const FlightClock* clock_;
  };

  explicit ThreadWatch(const FlightClock& clock) : clock_(clock) {}

  // Counts from now on, so that a thread that never starts is late as well.
  Beat watch(std::string name, double limit_s);

  std::vector<LateThread> late() const;  // in the order of watch()

 private:
  const FlightClock& clock_;
  mutable std::mutex mutex_;
  mutable std::list<std::shared_ptr<Watched>> watched_;
};

}  // namespace nadir
