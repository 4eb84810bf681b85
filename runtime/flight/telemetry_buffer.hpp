// The autopilot's recent telemetry, interpolated to the capture time of a frame.
//
// Times are our monotonic seconds of arrival: the autopilot's clock is not ours, and the delay of a usable link is some
// milliseconds. Inertial samples alone count from the autopilot's stamps, because they are integrated: the least delay
// that was seen takes the stamps to our clock. The autopilot's fused position is not an input, only attitude, heights
// and accelerations. The position of its real receiver is passed on for the record, from which a boresight is
// calibrated later; the localizer ignores it.
#pragma once

#include <Eigen/Geometry>
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
// The autopilot's clock of inertial samples against ours: they come delayed by up to …, and the clocks drift apart by …
inline constexpr double kMaxImuDelay_s = 0.5;
inline constexpr double kClockDrift = 1e-4;
inline constexpr double kPlaceGap_s = 1;  // between two fixes of the receiver

inline constexpr double kGimbalGap_s = 0.5;   // between the gimbal's messages around a frame
inline constexpr double kGimbalHeld_s = 0.1;  // from its last one to the frame: a gimbal moves fast
inline constexpr double kRateStep_s = 0.02;   // half of the time over which a gimbal's turn is measured

struct TelemetryNeeds {
  bool gimbal = false;     // the camera's attitude is that of a gimbal
  bool turn_rate = false;  // of the camera
  bool inertial = true;    // the samples of RAW_IMU and HIGHRES_IMU between frames
};

class TelemetryBuffer {
 public:
  explicit TelemetryBuffer(const Attitude& mount, TelemetryNeeds needs = {}) : mount_(mount), needs_(needs) {}

  void on_message(double time_s, const AircraftAttitude& attitude);
  void on_message(double time_s, const GimbalAttitude& gimbal);
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
  // On a gimbal, where velocity changes are unknown, headings are too: the aircraft does not turn with its camera.
  Telemetry at(double time_s);

 private:
  struct TimedAttitude {
    double time_s;
    Attitude aircraft;
    Eigen::Vector3d rate_rad_s;  // in its own axes
  };
  struct TimedGimbal {
    double time_s;
    Eigen::Quaterniond level_from_gimbal;
    bool from_north;
  };
  struct Height {
    double time_s, value_m;
  };
  struct TimedPlace {
    double time_s;
    LonLat place;
  };
  std::optional<double> stamped_s(double arrival_s, std::uint64_t stamp_us);
  std::vector<InertialSample> inertial_between(double from_s, double to_s) const;

  struct TimedAcceleration {  // horizontal
    double time_s;
    Eigen::Vector2d east_north_mps2;
  };

  std::optional<Attitude> aircraft_at(double time_s) const;
  std::optional<LonLat> place_at(double time_s) const;
  std::optional<Attitude> camera_at(double time_s) const;
  std::optional<Attitude> camera_on_gimbal_at(double time_s) const;
  std::optional<Eigen::Vector3d> camera_rate_at(double time_s) const;
  std::vector<TelemetryInterval> path(double from_s, double to_s) const;
  std::optional<Eigen::Vector2d> velocity_change(double from_s, double to_s) const;

  Attitude mount_;
  TelemetryNeeds needs_;
  std::deque<TimedAttitude> attitudes_;
  std::deque<TimedGimbal> gimbals_;
  std::deque<Height> home_heights_, msl_heights_, ranges_, terrain_heights_;
  std::deque<TimedAcceleration> accelerations_;
  std::deque<InertialSample> inertial_;  // in the camera's axes
  std::optional<double> imu_delay_s_;    // arrival less stamp, the least so far
  double imu_arrival_s_ = 0;
  std::deque<TimedPlace> places_;
  std::optional<double> last_time_s_;
};

}  // namespace nadir
