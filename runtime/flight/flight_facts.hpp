// What the threads tell the conductor. Each puts its news into a mailbox of this; none waits for an answer.
#pragma once

#include <string>
#include <variant>

#include "estimation/estimate.hpp"
#include "estimation/telemetry.hpp"
#include "geodesy/lon_lat.hpp"
#include "service/gps_health.hpp"

namespace nadir {

struct AutopilotEvent {
  bool authentic = false;
  bool armed = false;
};

struct CameraEvent {
  bool frame = false;
  std::string trouble{};
};

struct LocalizerEvent {
  double taken_s = 0;  // the picture
  bool late = false;   // a look at the map came back
  std::uint64_t index = 0;
  Estimate estimate;
  StateEstimate belief;
  AnchorVerdict verdict = AnchorVerdict::not_tried;
  std::optional<double> pitch_rad{}, roll_rad{};
};

struct StateNotSaved {
  std::string trouble;
};

struct TilesNotMade {
  std::string trouble;
};

struct FixJumped {
  double metres = 0;
};

struct PlaceHinted {
  LonLat place;
  double radius_m = 0;
  std::string by;
};

using FlightNews = std::variant<AutopilotEvent, CameraEvent, LocalizerEvent, StateNotSaved, TilesNotMade, FixJumped,
                                PlaceHinted, GpsFix3d, EkfReport>;

struct TimedNews {
  double time_s = 0;
  FlightNews news;
};

}  // namespace nadir
