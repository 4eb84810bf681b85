// Velocity gain and displacement of the aircraft since some moment, integrated from its accelerometers. Propagates a
// position through a blackout in which the aircraft turns.
//
// Specific force f (body axes: forward, right, down) is levelled with the last attitude (roll φ, pitch θ, yaw ψ):
//   a_NED = R_z(ψ) R_y(θ) R_x(φ) f + g;   gravity has no horizontal part, so a_N, a_E follow from f alone.
// An attitude error of 1° causes 0.17 m/s². Each sample holds since the one before, for kInertialGap_s at most. Where
// there are no samples the acceleration is taken as zero, and the time is counted as unknown. Times are seconds of any
// one clock; metres east and north.
#pragma once

#include <deque>
#include <optional>

#include "mavlink/messages.hpp"

namespace nadir {

inline constexpr double kInertialGap_s = 0.15;  // a sample holds for at most this long

class InertialMotion {
 public:
  struct Plane {
    double east = 0, north = 0;
  };

  // Motion between two moments, relative to constant velocity.
  struct Gain {
    Plane velocity_mps;    // add to the velocity at the first
    Plane displacement_m;  // add to that velocity times the elapsed time
    double unknown_s = 0;  // without samples
  };

  void on_message(double time_s, const AircraftAttitude& attitude);
  void on_message(double time_s, const ImuSample& sample);

  // A reference moment, at most kKept_s in the past when it is made. It stays valid however old it gets.
  struct Moment {
    double time_s = 0;
    Plane velocity_mps{}, displacement_m{};  // integrals since the first sample
    double known_s = 0;
  };
  Moment moment(double time_s) const;
  Gain gain(const Moment& from, double to_s) const;

 private:
  struct Sample {
    Moment until;             // at its arrival
    Plane acceleration_mps2;  // since the sample before
  };

  static constexpr double kKept_s = 5;
  std::optional<AircraftAttitude> attitude_;
  double attitude_s_ = 0;
  std::deque<Sample> samples_;
};

}  // namespace nadir
