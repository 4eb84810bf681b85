// The service's clock: the one place that owns time.
//
// Every rule and every age is judged in monotonic seconds, which nobody can set. UTC is a label for people, for the
// recorder and for the GPS fix's week; it may step by hours when the autopilot or a time server sets it, and nothing
// but the label changes. Monotonic time goes on while the computer sleeps (CLOCK_BOOTTIME) and, within one boot, from
// one run of the service to the next, so that a restart knows the age of what it saved.
#pragma once

#include <cstdint>
#include <stop_token>
#include <string>

namespace nadir {

class FlightClock {
 public:
  virtual ~FlightClock() = default;

  virtual double monotonic_s() const = 0;          // since the boot of the computer
  virtual std::int64_t unix_us() const = 0;        // UTC, microseconds since 1970
  virtual const std::string& boot_id() const = 0;  // of which boot monotonic_s() counts; empty when it is not known

  // Waits until that time. False when stop came first; a time that has passed already does not wait.
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

}  // namespace nadir
