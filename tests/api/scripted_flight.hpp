// A synthetic flight: circles around a place, in any state that the test needs. It publishes what the service would,
// for tests of the readers.
#pragma once

#include "api/flight_view.hpp"

namespace nadir::test {

class ScriptedFlight {
 public:
  explicit ScriptedFlight(LonLat centre = {8.5, 47.4}, double radius_m = 400) : centre_(centre), radius_m_(radius_m) {}

  // Seconds of the script's clock, not decreasing.
  FlightView at(double time_s, ServiceState state);

  void note(double time_s, EventSeverity severity, const std::string& kind, const std::string& text);
  void corrupt_tile(double time_s);
  void sign_link(bool is_signed) { link_signed_ = is_signed; }

 private:
  void note_change(double time_s, ServiceState state);

  LonLat centre_;
  double radius_m_;
  ServiceState state_ = ServiceState::boot;
  double since_s_ = 0;
  EventRing events_{100, 300}, alarms_{50, 300};
  std::uint64_t corrupt_tiles_ = 0;
  bool link_signed_ = true;
  FlightTrail trail_;
};

}  // namespace nadir::test
