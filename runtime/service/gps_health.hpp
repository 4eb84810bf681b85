// Whether the aircraft's real GPS receiver can be trusted: denied, spoofed, or fit to be used (again).
//
// It goes by what the autopilot tells of the receiver (GPS_RAW_INT) and of its filter (EKF_STATUS_REPORT), and by where
// pictures say that the aircraft is. Never hand it the GPS that we ourselves play (GPS_INPUT comes back as a receiver)
// nor the autopilot's fused position.
//
// Spoofed: a step that no aircraft flies, an impossible speed, the filter's own alarm, or a disagreement with pictures
// beyond both uncertainties, as slow drag-off ends in. Suspicion is quick and trust is slow: after trouble GPS must be
// undisturbed for a stable interval and agree with the pictures for as long. Only when it was merely denied, never
// caught lying, and pictures have nothing to say, is a much longer stable interval enough. A receiver that has been
// looking for its first fix since the service was started on the ground was not denied by anybody: seconds are enough.
//
// Times are monotonic seconds of arrival; they come in with the facts.
#pragma once

#include <optional>
#include <string>

#include "geodesy/lon_lat.hpp"
#include "service/service_facts.hpp"

namespace nadir {

inline constexpr double kGpsSilent_s = 1.5;          // no message
inline constexpr double kGpsNoFix_s = 0.5;           // messages without a 3-D fix
inline constexpr double kEkfAlarm_s = 1.0;           // the autopilot's filter complains for so long
inline constexpr double kLed_s = 15;                 // so long what it says may be about our fix
inline constexpr double kMaxGroundSpeed_m_s = 100;   // of any aircraft that we fly on, with the wind
inline constexpr double kStepMargin_m = 30;          // beyond what speed and accuracies explain
inline constexpr double kMaxAcceleration_m_s2 = 15;  // between two fixes
inline constexpr double kMaxGpsSigma_m = 10;         // a liar may claim any accuracy; more is not believed
inline constexpr double kDefaultGpsSigma_m = 3;      // when the receiver tells none
inline constexpr double kDisagreementSigmas = 4;
inline constexpr double kMinDisagreement_m = 25;
inline constexpr double kDisagreement_s = 1.0;   // for so long
inline constexpr double kMaxVisionSigma_m = 60;  // vaguer positions accuse and acquit nobody
inline constexpr double kMaxVisionAge_s = 1.0;   // nor do older ones
inline constexpr double kGpsStable_s = 10;       // undisturbed, and in agreement
inline constexpr double kGpsFirst_s = 5;         // undisturbed, after a search for its first fix
inline constexpr double kGpsStableAlone_s = 60;  // undisturbed, with nobody to agree with

struct GpsFix3d {
  double time_s = 0;
  bool has_fix = false;  // three-dimensional or better
  LonLat place;
  std::optional<double> ground_speed_m_s;
  std::optional<double> accuracy_m;  // horizontal, one sigma
};

struct EkfReport {
  double time_s = 0;
  bool knows_position = false;  // absolute, horizontal
  bool gps_glitch = false;
};

// Only what pictures carry: satellite_anchored and vo_extrapolated.
struct VisionPosition {
  double time_s = 0;
  LonLat place;
  double sigma_m = 0;  // one axis
};

class GpsHealth {
 public:
  explicit GpsHealth(double now_s) : last_message_s_(now_s) {}

  void hear(const GpsFix3d& fix);
  void hear(const EkfReport& report);
  void hear(const VisionPosition& vision);
  // The autopilot is being told a fix of ours. What its filter says is about that fix, and not about the receiver:
  // ArduPilot also reports a glitch when the fix that it goes by claims a speed that is known to no better than 1.5
  // m/s.
  void led(double now_s) { led_s_ = now_s; }
  // The service was started again in flight: who has no fix now is denied one.
  void resumed() { had_its_first_ = true; }

  // The verdict now. Call it several times a second: silence is told by nobody. While the link to the autopilot is down
  // the receiver's silence says nothing, and the verdict stays.
  GpsJudged judge(double now_s, bool link_up = true);

 private:
  void look_for_step(const GpsFix3d& fix);
  void compare_with_vision(const GpsFix3d& fix);
  void disturb();
  std::optional<GpsJudged> trouble(double now_s) const;
  bool fit_again(double now_s) const;
  bool vision_speaks(double time_s) const;
  bool filter_goes_by_it(double now_s) const;

  GpsJudged judged_;
  double last_message_s_;
  std::optional<GpsFix3d> last_fix_;
  std::optional<VisionPosition> vision_;
  std::optional<double> no_fix_since_s_;
  std::optional<double> good_since_s_;    // undisturbed
  std::optional<double> agrees_since_s_;  // with pictures
  std::optional<double> disagrees_since_s_;
  std::optional<double> glitch_since_s_;
  std::optional<double> ekf_lost_since_s_;
  std::optional<double> led_s_;
  bool ekf_knew_ = false;
  std::string lie_;    // a step or a speed since the last verdict
  bool lied_ = false;  // since it was trusted last
  bool had_its_first_ = false;
};

}  // namespace nadir
