// Tells the service manager that the service lives, but only while every thread does. When one hangs, systemd hears
// nothing, kills the service and starts it again; the state directory carries the flight over.
#pragma once

#include <optional>
#include <string>

#include "service/cadence.hpp"
#include "service/service_manager.hpp"
#include "service/thread_watch.hpp"

namespace nadir {

class Watchdog {
 public:
  // interval_s: as systemd asks for it; it is fed three times as often. nullopt: systemd does not ask.
  Watchdog(const ThreadWatch& threads, const ServiceManager& manager, std::optional<double> interval_s, double now_s)
      : threads_(threads),
        manager_(manager),
        asked_(interval_s.has_value()),
        cadence_(interval_s.value_or(1) / 3, now_s) {}

  // To be called often, by one thread. Returns who is late when that has changed ("" when nobody is any more), so that
  // it can be recorded once.
  std::optional<std::string> tick(double now_s);

 private:
  const ThreadWatch& threads_;
  const ServiceManager& manager_;
  bool asked_;
  Cadence cadence_;
  std::string late_names_;
};

}  // namespace nadir
