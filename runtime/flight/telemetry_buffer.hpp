// The autopilot's recent telemetry, interpolated to the capture time of a frame.
//
// Times are our monotonic seconds of arrival: the autopilot's clock is not ours, and the delay of a usable link is some
// milliseconds. The autopilot's fused position is not an input, only attitude, heights and accelerations. The position
// of its real receiver is passed on for the record, from which a boresight is calibrated later; the localizer ignores
// it.
#pragma once

#include <deque>
#include <optional>

#include "estimation/telemetry.hpp"
#include "mavlink/messages.hpp"
#include "vision/camera.hpp"

namespace nadir {

inline constexpr double kTelemetryKept_s = 120;       // much longer than the longest blackout with a fix
inline constexpr double kMaxTelemetryInterval_s = 1;  // of the path between two frames: no aircraft turns back in less
inline constexpr double kAttitudeGap_s = 0.5;         // between the messages around a frame, or from the last one to it
inline constexpr double kHeightGap_s = 2;
inline constexpr double kImuGap_s = 0.15;
inline constexpr double kPlaceGap_s = 1;  // between two fixes of the receiver

class TelemetryBuffer {
 public:
  explicit TelemetryBuffer(const Attitude& mount) : mount_(mount) {}

  void on_message(double time_s, const AircraftAttitude& attitude);
  void on_message(double time_s, const GlobalPosition& position);  // its heights alone
  void on_message(double time_s, const GroundDistance& distance);
  void on_message(double time_s, const GroundHeight& height);
  void on_message(double time_s, const ImuSample& sample);
  void on_message(double time_s, const GpsRaw& fix);  // with a fix, never our own

  // Barometric, mostly.
  std::optional<double> above_home_m(double time_s) const;
  std::optional<double> msl_m(double time_s) const;

  // The telemetry at time_s; unknown values are empty. Height above ground: of a range finder, else of the autopilot's
  // terrain, else none (with a terrain model use msl_m). Path and velocity change are those since the previous call.
  Telemetry at(double time_s);

 private:
  struct TimedAttitude {
    double time_s;
    Attitude aircraft;
  };
  struct Height {
    double time_s, value_m;
  };
  struct TimedPlace {
    double time_s;
    LonLat place;
  };
  struct TimedAcceleration {  // horizontal
    double time_s;
    Eigen::Vector2d east_north_mps2;
  };

  std::optional<Attitude> aircraft_at(double time_s) const;
  std::optional<LonLat> place_at(double time_s) const;
  std::optional<Attitude> camera_at(double time_s) const;
  std::vector<TelemetryInterval> path(double from_s, double to_s) const;
  std::optional<Eigen::Vector2d> velocity_change(double from_s, double to_s) const;

  Attitude mount_;
  std::deque<TimedAttitude> attitudes_;
  std::deque<Height> home_heights_, msl_heights_, ranges_, terrain_heights_;
  std::deque<TimedAcceleration> accelerations_;
  std::deque<TimedPlace> places_;
  std::optional<double> last_time_s_;
};

}  // namespace nadir
