// Which autopilot is there.
#pragma once

#include <string>

#include "provision/autopilot_session.hpp"

namespace nadir {

struct AutopilotIdentity {
  MavlinkAddress address;
  std::string uid;      // hexadecimal: of the processor, the same after every update
  std::string version;  // "4.6.1"
};

// Throws Error when there is none, when it is not ArduPilot, armed, or does not say who it is.
AutopilotIdentity identify(AutopilotSession& session);

}  // namespace nadir
