// Whether the autopilot's parameters are still those that provisioning found or set: the airframe file lists them.
// Asked for while the aircraft is disarmed, a few with each heartbeat, all of them again and again: a ground station
// may change one at any time. In flight nothing is asked; it would change nothing.
#pragma once

#include <cstddef>
#include <map>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "mavlink/parameters.hpp"
#include "service/onboard_event.hpp"
#include "vision/camera.hpp"

namespace nadir {

class ParameterWatch {
 public:
  ParameterWatch(std::vector<AirframeParameter> expected, MavlinkAddress autopilot)
      : expected_(std::move(expected)), autopilot_(autopilot) {}

  // What to send now.
  std::vector<OutgoingMessage> on_heartbeat(const Heartbeat& heartbeat);

  // An event when the parameter differs, differs in another way, or is as expected again.
  std::optional<ParameterChanged> on_message(const ParameterValue& value);

 private:
  std::vector<AirframeParameter> expected_;
  MavlinkAddress autopilot_;
  ParameterEncoding encoding_ = ParameterEncoding::cast;
  std::size_t next_ = 0;
  std::map<std::string, double> different_;
};

}  // namespace nadir
