// Why a link to the autopilot is not open, and what to do about it: what the system says about the port or the address,
// in the same words wherever a program waits for the autopilot.
#pragma once

#include <optional>
#include <string>

#include "mavlink/transport.hpp"

namespace nadir {

struct ClosedLink {
  std::string reason;  // "serial:/dev/ttyUSB0:57600: No such file or directory"
  std::string fix;
};

// nullopt: it is open.
inline std::optional<ClosedLink> closed_link(const Transport& transport) {
  if (transport.is_open()) return std::nullopt;
  return ClosedLink{.reason = transport.last_error().empty() ? "not connected yet" : transport.last_error(),
                    .fix =
                        "check that the port is there and its name is right, that no other program uses it (nadird? a "
                        "ground station?), and that you may open it (serial ports: group dialout)"};
}

}  // namespace nadir
