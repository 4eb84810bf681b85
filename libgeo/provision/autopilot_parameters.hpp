// The parameters that an autopilot needs to fly by our fixes (docs/autopilot.md), what they are, and setting them.
#pragma once

#include <string>
#include <vector>

#include "provision/autopilot_session.hpp"

namespace nadir {

struct AutopilotParameter {
  std::string name;
  double wanted = 0;
  double present = 0;
  std::uint8_t type = 0;

  bool differs() const { return present != wanted; }
};

// receiver: 1 or 2, the one that GPS_INPUT plays. Throws Error for one that the autopilot does not tell.
std::vector<AutopilotParameter> read_parameters(AutopilotSession& session, MavlinkAddress autopilot, int receiver);

// Sets those that differ, and reads each back. What may have been changed is in `changed`, also when it throws.
void set_parameters(AutopilotSession& session, MavlinkAddress autopilot,
                    const std::vector<AutopilotParameter>& parameters, std::vector<AutopilotParameter>& changed);

// Puts back what was present, newest first. The names of those that could not be.
std::vector<std::string> restore_parameters(AutopilotSession& session, MavlinkAddress autopilot,
                                            const std::vector<AutopilotParameter>& changed);

}  // namespace nadir
