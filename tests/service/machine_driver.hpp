// Drives the state machine by hand: the clock is a number that the test advances.
#pragma once

#include <gtest/gtest.h>

#include <string>
#include <vector>

#include "service/service_machine.hpp"

namespace nadir::test {

// What the state machine uses of an estimate. anchored: a map match was accepted with it.
inline LocalizedFrame estimate(SourceLabel source, double sigma_m, bool anchored = false) {
  LocalizedFrame frame;
  frame.report.estimate.source = source;
  frame.report.estimate.sigma_m = sigma_m;
  frame.report.estimate.hpl_m = 4.9 * sigma_m;  // one hypothesis, at a risk of 1e-5
  if (anchored) frame.report.anchor.verdict = AnchorVerdict::accepted;
  return frame;
}

class MachineDriver {
 public:
  explicit MachineDriver(double camera_interval_s = 1.0 / 3)
      : machine_(now_s, {.camera_interval_s = camera_interval_s, .parameters = ParameterCheck::as_provisioned}) {}
  explicit MachineDriver(const ServiceConfig& config) : machine_(now_s, config) {}

  void on(const OnboardEvent& event) { keep(machine_.on_event(now_s, event)); }
  void tick() { keep(machine_.update(now_s)); }

  // One frame and at once its estimate.
  void frame(SourceLabel source, double sigma_m = 5) {
    on(FrameReceived{});
    on(estimate(source, sigma_m));
  }

  // A visual frame with this protection level, or none.
  void frame_with_level(std::optional<double> hpl_m, SourceLabel source = SourceLabel::vo_extrapolated) {
    LocalizedFrame localized = estimate(source, 5);
    localized.report.estimate.hpl_m = hpl_m;
    on(FrameReceived{});
    on(localized);
  }
  void fly_with_level(double seconds, std::optional<double> hpl_m, SourceLabel source = SourceLabel::vo_extrapolated) {
    for (const double end_s = now_s + seconds; now_s + 1e-9 < end_s;) {
      wait(0.2);
      frame_with_level(hpl_m, source);
    }
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

  // Equal frames at 5 Hz for so long; the last one at the end.
  void fly(double seconds, SourceLabel source = SourceLabel::vo_extrapolated, double sigma_m = 5) {
    const double end_s = now_s + seconds;
    while (now_s + 0.2 < end_s) {
      wait(0.2);
      frame(source, sigma_m);
    }
    wait(end_s - now_s);
    frame(source, sigma_m);
  }

  void boot_to_search() {
    on(PackageVerified{true});
    on(AutopilotHeartbeat{LinkAuthentication::signature, false});
  }
  void boot_to_normal() {
    boot_to_search();
    frame(SourceLabel::satellite_anchored);
  }
  // Heartbeats during fly() and wait() come only where a test sends them.
  void heartbeat() { on(AutopilotHeartbeat{LinkAuthentication::signature, true}); }

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
