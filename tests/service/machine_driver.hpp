// Flies the state machine by hand: the clock is a number that the test moves.
#pragma once

#include <gtest/gtest.h>

#include <string>
#include <vector>

#include "service/service_machine.hpp"

namespace nadir::test {

class MachineDriver {
 public:
  explicit MachineDriver(double camera_interval_s = 1.0 / 3)
      : machine_(now_s, {.camera_interval_s = camera_interval_s}) {}

  void fact(const ServiceFact& fact) { keep(machine_.update(now_s, fact)); }
  void tick() { keep(machine_.update(now_s)); }

  // One picture and at once its estimate.
  void picture(SourceLabel source, double sigma_m = 5) {
    fact(FrameReceived{});
    fact(EstimateMade{source, sigma_m, false});
  }

  // Time goes by at ten ticks a second; nothing else happens.
  void wait(double seconds) {
    const double end_s = now_s + seconds;
    while (now_s + 0.1 < end_s) {
      now_s += 0.1;
      tick();
    }
    now_s = end_s;
    tick();
  }

  // Pictures at 5 Hz, all alike, for so long; the last one at the end.
  void fly(double seconds, SourceLabel source = SourceLabel::vo_extrapolated, double sigma_m = 5) {
    const double end_s = now_s + seconds;
    while (now_s + 0.2 < end_s) {
      wait(0.2);
      picture(source, sigma_m);
    }
    wait(end_s - now_s);
    picture(source, sigma_m);
  }

  void boot_to_search() {
    fact(PackageVerified{true});
    fact(AutopilotHeartbeat{true, false});
  }
  void boot_to_normal() {
    boot_to_search();
    picture(SourceLabel::satellite_anchored);
  }
  // The autopilot goes on speaking through fly() and wait() only where a test says so.
  void heard() { fact(AutopilotHeartbeat{true, true}); }

  ServiceState state() const { return machine_.status().state; }
  ServiceStatus status() const { return machine_.status(); }
  bool saw(ServiceReason reason) const { return count(reason) > 0; }
  int count(ServiceReason reason) const {
    int found = 0;
    for (const StateTransition& event : events) found += event.reason == reason;
    return found;
  }

  double now_s = 1000;
  std::vector<StateTransition> events;

 private:
  void keep(const std::vector<StateTransition>& more) { events.insert(events.end(), more.begin(), more.end()); }

  ServiceMachine machine_;
};

}  // namespace nadir::test
