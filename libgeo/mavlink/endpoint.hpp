// Where the autopilot is, as text:
//   udpin:HOST:PORT    listen there, answer whoever proves to be the autopilot
//   udpout:HOST:PORT   send there first
//   tcp:HOST:PORT      connect
//   serial:PATH:BAUD   a serial port, 8 bits, no parity, no flow control
// Hosts are addresses ("127.0.0.1", "[::1]") or "localhost": an aircraft does not wait for a name server.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>

namespace nadir {

struct Endpoint {
  enum class Kind { udp_listen, udp_send, tcp, serial };
  Kind kind = Kind::udp_listen;
  std::string host{};      // without brackets
  std::uint16_t port = 0;  // 0 only with udpin: any free one
  std::string device{};
  int baud = 0;

  bool operator==(const Endpoint&) const = default;
};

// Throws UsageError.
Endpoint parse_endpoint(std::string_view text);
std::string to_string(const Endpoint& endpoint);

// Rates that this system's serial ports know.
bool is_known_baud(int baud);

}  // namespace nadir
