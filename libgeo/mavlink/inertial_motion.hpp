// What the aircraft's accelerometers say that it did since some moment: velocity gained and way gone beside the
// velocity that it had then. Carries a position through a blackout in which the aircraft turns.
//
// Specific force, turned level by the attitude that the autopilot told last: its horizontal part is the horizontal
// acceleration. An attitude wrong by a degree pushes by 0.17 m/s². Where no samples came it is not known what the
// aircraft did: then it is taken to have gone straight on, and the time is counted. Seconds of any one clock; metres
// east and north.
#pragma once

#include <deque>
#include <optional>

#include "mavlink/messages.hpp"

namespace nadir {

inline constexpr double kInertialGap_s = 0.15;  // a sample stands for no longer than this

class InertialMotion {
 public:
  struct Plane {
    double east = 0, north = 0;
  };

  // What was gained between two moments.
  struct Gain {
    Plane velocity_m_s;  // to be added to the velocity at the first
    Plane way_m;         // to be added to that velocity times the time between
    double unknown_s = 0;
  };

  void hear(double time_s, const AircraftAttitude& attitude);
  void hear(double time_s, const ImuSample& sample);

  // A moment to count from, which may lie some seconds in the past (kKept_s). It stays good however long ago it gets.
  struct Moment {
    double time_s = 0;
    Plane velocity_m_s{}, way_m{};  // sums since the first sample
    double known_s = 0;
  };
  Moment moment(double time_s) const;
  Gain gain(const Moment& from, double to_s) const;

 private:
  struct Sample {
    Moment until;     // when it came
    Plane push_m_s2;  // from the sample before until then, and for a moment longer
  };

  static constexpr double kKept_s = 5;
  std::optional<AircraftAttitude> attitude_;
  double attitude_s_ = 0;
  std::deque<Sample> samples_;
};

}  // namespace nadir
