// Whether the aircraft's real GPS receiver is usable: trusted, denied or spoofed. And when a trusted one suggests where
// to search.
//
// Inputs: the receiver's messages (GPS_RAW_INT), the autopilot's filter (EKF_STATUS_REPORT), and visual positions.
// Never pass it the fixes that we send (GPS_INPUT comes back as a receiver) nor the autopilot's fused position.
//
// Spoofed: a step or a speed beyond what the aircraft can fly, the filter's glitch alarm, or a disagreement with
// vision, which is how a slow drag-off ends. With d = GPS less vision, both at the fix's time (vision is propagated by
// its own velocity v, for dt), it is a χ² test of two degrees of freedom:
//
//   D² = dᵀ R⁻¹ d      R = σ_gps² I + P_vision + (σ_v dt)² I + σ_t² v vᵀ
//
// σ_t: how old a fix may be when its message comes. Both errors last longer than a drag does until it is found, so that
// looks do not add up: sums and likelihood ratios over windows find it no earlier (docs/closed-loop.md).
//
// Distrust is quick, trust is slow: after denial or spoofing, GPS must be undisturbed for a stable interval and agree
// with vision for as long, by a smaller D². If it was merely denied, never spoofed, and there is no visual position, a
// much longer stable interval is enough. A receiver that has been searching for its first fix since the service started
// on the ground was not denied: seconds are enough.
//
// The numbers are in service_rules.hpp. Times are monotonic seconds of arrival, and come in with the events.
#pragma once

#include <Eigen/Core>
#include <optional>
#include <string>

#include "geodesy/lon_lat.hpp"
#include "service/onboard_event.hpp"
#include "service/service_rules.hpp"

namespace nadir {

struct VisionPosition {
  double time_s = 0;
  LonLat place;
  Eigen::Matrix2d covariance_m2 = Eigen::Matrix2d::Zero();  // east, north
  Eigen::Vector2d velocity_mps = Eigen::Vector2d::Zero();   // east, north
  double velocity_sigma_mps = 0;                            // one axis
};

class GpsHealth {
 public:
  explicit GpsHealth(double now_s) : last_message_s_(now_s) {}

  void on_event(const GpsFix3d& fix);
  void on_event(const EkfReport& report);
  void on_event(const LocalizedFrame& frame);  // its position, if it is visual
  void on_vision(const VisionPosition& vision);
  // The autopilot receives a fix of ours: its filter's alarms are about that fix, not about the receiver. ArduPilot
  // also reports a glitch when the fix in use has a speed accuracy of 1.5 m/s or worse.
  void our_fix_in_use(double now_s) { our_fix_s_ = now_s; }
  // The service was restarted in flight: a receiver without a fix now is denied one.
  void on_restart() { had_first_fix_ = true; }

  // The assessment now. Call it several times a second: silence causes no event. While the link to the autopilot is
  // down the receiver's silence means nothing, and the assessment stays.
  GpsAssessment assess(double now_s, bool link_up = true);

 private:
  void check_step(const GpsFix3d& fix);
  void compare_with_vision(const GpsFix3d& fix);
  void reset_stability();
  std::optional<GpsAssessment> find_fault(double now_s) const;
  bool trustworthy_again(double now_s) const;
  bool vision_available(double time_s) const;
  bool filter_uses_receiver(double now_s) const;

  GpsAssessment assessment_;
  double last_message_s_;
  std::optional<GpsFix3d> last_fix_;
  std::optional<VisionPosition> vision_;
  std::optional<double> no_fix_since_s_;
  std::optional<double> good_since_s_;    // undisturbed
  std::optional<double> agrees_since_s_;  // with vision
  std::optional<double> disagrees_since_s_;
  std::optional<double> glitch_since_s_;
  std::optional<double> ekf_lost_since_s_;
  std::optional<double> our_fix_s_;
  bool ekf_had_position_ = false;
  double apart_m_ = 0;    // from the visual position, at the last fix
  std::string fault_;     // a step or a speed since the last assessment
  bool spoofed_ = false;  // since it was last trusted
  bool had_first_fix_ = false;
};

// When a trusted GPS suggests where to search first. Never where we are: only the map may confirm that.
class GpsHints {
 public:
  // Whether to send this place as a hint: the first one, and while there is no visual position each one that is half a
  // radius from the last, because a hint from before take-off is worthless in the air.
  bool due(LonLat place, bool position_known);

 private:
  std::optional<LonLat> last_;
};

}  // namespace nadir
