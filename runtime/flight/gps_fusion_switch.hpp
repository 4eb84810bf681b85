// Takes GPS out of PX4's filter while we judge it denied or spoofed, and gives it back when it is trusted again:
// parameter EKF2_GPS_CTRL. PX4 fuses GPS and our position side by side, so that a GPS that is dragged off slowly takes
// the filter along, and it resets to a receiver that returns after a denial without asking anyone (docs/px4.md).
//
// The usual value is that of the airframe file, else what PX4 says first. 0, "GPS is not fused", is left alone. PX4
// stores parameters: after a power cut the value of then is found before take-off (parameter_watch.hpp).
#pragma once

#include <optional>
#include <vector>

#include "mavlink/parameters.hpp"
#include "service/onboard_event.hpp"
#include "vision/camera.hpp"

namespace nadir {

class GpsFusionSwitch {
 public:
  GpsFusionSwitch(const std::vector<AirframeParameter>& provisioned, MavlinkAddress autopilot);

  // What to send now; call it often.
  std::optional<OutgoingMessage> turn(double now_s, GpsVerdict verdict);

  // What the operator is told, once for each change that PX4 has confirmed.
  std::optional<StatusText> on_message(const ParameterValue& value);

  // This value is our own change, still wanted or not yet taken back: the parameter does not deviate.
  bool is_ours(const ParameterValue& value) const;

  // As PX4 said last. Then its GPS alarms are those of the moment when GPS was taken out.
  bool is_off() const;

 private:
  MavlinkAddress autopilot_;
  std::optional<double> usual_, present_;
  bool off_ = false;      // as the last verdict wants it
  bool changed_ = false;  // since it wanted it, until PX4 has confirmed the usual value
  bool told_off_ = false;
  double next_s_ = 0;
};

}  // namespace nadir
