// What the autopilot said lately, so that a picture gets what was true when it was taken.
//
// Times are our monotonic seconds of arrival: the autopilot's clock is not ours, and on a link that is fit to fly with
// the delay is some milliseconds. The autopilot's own idea of where it is has no way in, only attitude, heights and
// accelerations. What its real receiver says goes along for the record, from which a boresight is found later; the
// localizer does not look at it.
#pragma once

#include <deque>
#include <optional>

#include "estimation/telemetry.hpp"
#include "mavlink/messages.hpp"
#include "vision/camera.hpp"

namespace nadir {

inline constexpr double kTelemetryKept_s = 120;  // much longer than a blackout after which a fix is still told
inline constexpr double kLongestStretch_s = 1;   // of the way between two pictures: no aircraft turns back in less
inline constexpr double kAttitudeGap_s = 0.5;    // between the messages around a picture, or from the last one to it
inline constexpr double kHeightGap_s = 2;
inline constexpr double kImuGap_s = 0.15;
inline constexpr double kPlaceGap_s = 1;  // between two fixes of the receiver

class TelemetryBuffer {
 public:
  explicit TelemetryBuffer(const Attitude& mount) : mount_(mount) {}

  void hear(double time_s, const AircraftAttitude& attitude);
  void hear(double time_s, const GlobalPosition& position);  // its heights alone
  void hear(double time_s, const GroundDistance& distance);
  void hear(double time_s, const GroundHeight& height);
  void hear(double time_s, const ImuSample& sample);
  void hear(double time_s, const GpsRaw& fix);  // with a fix, and never our own

  // The latest message is so old; nullopt: none yet.
  std::optional<double> attitude_age_s(double now_s) const;
  // By the barometer, mostly.
  std::optional<double> above_home_m(double time_s) const;
  std::optional<double> msl_m(double time_s) const;

  // What was true at time_s; what is not known is left out. Height above ground: a range finder's, else the autopilot's
  // terrain, else nothing (who has a map can do better: msl_m). Successive calls: the way and the change of velocity
  // are those since the call before.
  Telemetry at(double time_s);

 private:
  struct HeldAttitude {
    double time_s;
    Attitude aircraft;
  };
  struct Height {
    double time_s, value_m;
  };
  struct Place {
    double time_s;
    LonLat at;
  };
  struct Push {  // change of velocity per second, in the horizontal plane
    double time_s;
    Eigen::Vector2d east_north_mps2;
  };

  std::optional<Attitude> aircraft_at(double time_s) const;
  std::optional<LonLat> place_at(double time_s) const;
  std::optional<Attitude> camera_at(double time_s) const;
  std::vector<TelemetryInterval> way(double from_s, double to_s) const;
  std::optional<Eigen::Vector2d> velocity_change(double from_s, double to_s) const;

  Attitude mount_;
  std::deque<HeldAttitude> attitudes_;
  std::deque<Height> home_heights_, msl_heights_, ranges_, terrain_heights_;
  std::deque<Push> pushes_;
  std::deque<Place> places_;
  std::optional<double> last_asked_s_;
};

}  // namespace nadir
