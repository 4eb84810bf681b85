// The service's clock: the only source of time.
//
// Every rule and every age uses monotonic seconds, which nobody can set. UTC is a label for people, the recorder and
// the GPS week; it may step by hours when the autopilot or a time server sets it, and only the label changes. Monotonic
// time continues while the computer sleeps (CLOCK_BOOTTIME) and, within one boot, from one run of the service to the
// next, so that a restart knows the age of what was saved.
#pragma once

#include <cmath>
#include <cstdint>
#include <stop_token>
#include <string>

namespace nadir {

class FlightClock {
 public:
  virtual ~FlightClock() = default;

  virtual double monotonic_s() const = 0;          // since the boot of the computer
  virtual std::int64_t unix_us() const = 0;        // UTC, microseconds since 1970
  virtual const std::string& boot_id() const = 0;  // the boot of monotonic_s(); empty if unknown

  // Waits until that time. False: stop was requested first. A time in the past does not wait.
  virtual bool wait_until(double until_s, std::stop_token stop) const = 0;
};

class SystemFlightClock final : public FlightClock {
 public:
  SystemFlightClock();

  double monotonic_s() const override;
  std::int64_t unix_us() const override;
  const std::string& boot_id() const override { return boot_id_; }
  bool wait_until(double until_s, std::stop_token stop) const override;

 private:
  std::string boot_id_;
};

// Something periodic: fixes at 10 Hz, the state on disk at 1 Hz. Due times lie on a grid, so that a late call does not
// shift the following ones; after a long stall it is due once, not in a burst.
class Cadence {
 public:
  Cadence(double period_s, double first_s) : period_s_(period_s), next_s_(first_s) {}

  double next_s() const { return next_s_; }

  // Whether it is due now; then the next due time is set.
  bool due(double now_s) {
    if (now_s < next_s_) return false;
    next_s_ += period_s_ * (std::floor((now_s - next_s_) / period_s_) + 1);
    if (next_s_ <= now_s) next_s_ += period_s_;  // rounding
    return true;
  }

 private:
  double period_s_;
  double next_s_;
};

}  // namespace nadir
