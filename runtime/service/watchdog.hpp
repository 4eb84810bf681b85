// Supervision of the service: each thread beats, the watchdog names threads that are late, and systemd learns that the
// service is alive only while all of them are. If one hangs, systemd kills the service and restarts it; the state
// directory lets the flight continue (saved_flight.hpp).
#pragma once

#include <atomic>
#include <list>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <string_view>
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

// A beat is one store to an atomic; it never waits. A thread whose Beat is destroyed has ended normally and is no
// longer watched; a thread that ends by an exception must end the service.
class ThreadWatch {
  struct Watched {
    std::string name;
    double limit_s;
    std::atomic<double> last_s;
    std::atomic<bool> ended{false};
  };

 public:
  // Held by the thread. Movable; must not outlive the clock.
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

  // The time counts from now on, so that a thread that never starts is late too.
  Beat watch(std::string name, double limit_s);

  std::vector<LateThread> late() const;  // in the order of watch()

 private:
  const FlightClock& clock_;
  mutable std::mutex mutex_;
  mutable std::list<std::shared_ptr<Watched>> watched_;
};

// systemd's notification protocol (sd_notify(3)) over the datagram socket in NOTIFY_SOCKET, without libsystemd. Without
// such a socket, started by hand, it does nothing. A message that cannot be sent is lost: the flight never waits.
class ServiceManager {
 public:
  // socket: a path, or "@name" in the abstract namespace; nullopt: not under systemd. Throws Error for an invalid name.
  explicit ServiceManager(std::optional<std::string> socket);
  ~ServiceManager();
  ServiceManager(const ServiceManager&) = delete;
  ServiceManager& operator=(const ServiceManager&) = delete;

  bool listens() const { return fd_ >= 0; }

  bool ready(std::string_view status) const;   // READY=1; false: not sent
  bool status(std::string_view status) const;  // one line for `systemctl status`
  bool alive() const;                          // WATCHDOG=1
  bool stopping(std::string_view status) const;

 private:
  bool send(const std::string& message) const;

  std::string address_;  // as the kernel expects it: a leading NUL for the abstract namespace
  int fd_ = -1;
};

// What systemd has set up for this process. Read it once, before there are threads.
struct ServiceEnvironment {
  std::optional<std::string> notify_socket;   // NOTIFY_SOCKET
  std::optional<double> watchdog_interval_s;  // WATCHDOG_USEC, when WATCHDOG_PID is absent or ours
};
ServiceEnvironment read_service_environment();

class Watchdog {
 public:
  // interval_s: systemd's watchdog interval; it is notified three times as often. nullopt: no watchdog.
  Watchdog(const ThreadWatch& threads, const ServiceManager& manager, std::optional<double> interval_s, double now_s)
      : threads_(threads),
        manager_(manager),
        enabled_(interval_s.has_value()),
        cadence_(interval_s.value_or(1) / 3, now_s) {}

  // Call it often, from one thread. Returns the late threads when they have changed ("" when none is late any more), so
  // that they are recorded once.
  std::optional<std::string> tick(double now_s);

 private:
  const ThreadWatch& threads_;
  const ServiceManager& manager_;
  bool enabled_;
  Cadence cadence_;
  std::string late_names_;
};

}  // namespace nadir
