#include "mavlink/endpoint.hpp"

#include <arpa/inet.h>

#include <charconv>
#include <optional>

#include "base/error.hpp"
#include "mavlink/serial_speed.hpp"

namespace nadir {
namespace {

[[noreturn]] void refuse(std::string_view text, std::string what, std::string expected) {
  throw UsageError({.what = std::move(what),
                    .where = std::string(text),
                    .expected = std::move(expected),
                    .fix = "for example udpin:0.0.0.0:14550 or serial:/dev/ttyAMA0:921600"});
}

std::optional<int> whole_number(std::string_view text) {
  int value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (text.empty() || error != std::errc() || end != text.data() + text.size()) return std::nullopt;
  return value;
}

bool is_address(const std::string& host) {
  unsigned char bytes[16];
  return ::inet_pton(AF_INET, host.c_str(), bytes) == 1 || ::inet_pton(AF_INET6, host.c_str(), bytes) == 1;
}

}  // namespace

bool is_known_baud(int baud) { return serial_speed(baud).has_value(); }

Endpoint parse_endpoint(std::string_view text) {
  const std::size_t first = text.find(':');
  const std::size_t last = text.rfind(':');
  if (first == std::string_view::npos || last == first) {
    refuse(text, "this is no address of an autopilot", "KIND:WHERE:NUMBER");
  }
  const std::string_view kind = text.substr(0, first);
  std::string where(text.substr(first + 1, last - first - 1));
  const std::optional<int> number = whole_number(text.substr(last + 1));

  Endpoint endpoint;
  if (kind == "serial") {
    endpoint.kind = Endpoint::Kind::serial;
    if (!where.starts_with('/')) refuse(text, "the serial port is no path", "an absolute path such as /dev/ttyAMA0");
    if (!number || !is_known_baud(*number)) refuse(text, "this baud rate is not known", "57600, 115200, 921600, …");
    endpoint.device = std::move(where);
    endpoint.baud = *number;
    return endpoint;
  }
  if (kind == "udpin") {
    endpoint.kind = Endpoint::Kind::udp_listen;
  } else if (kind == "udpout") {
    endpoint.kind = Endpoint::Kind::udp_send;
  } else if (kind == "tcp") {
    endpoint.kind = Endpoint::Kind::tcp;
  } else {
    refuse(text, "this kind of link is not known", "udpin, udpout, tcp or serial");
  }
  if (where.starts_with('[') && where.ends_with(']')) {
    where = where.substr(1, where.size() - 2);
  } else if (where.find(':') != std::string::npos) {
    refuse(text, "the address has too many colons", "IPv6 addresses in brackets");
  }
  if (where == "localhost") where = "127.0.0.1";
  if (!is_address(where))
    refuse(text, "the host is no address", "numbers such as 192.168.4.1; names are not looked up");
  const int lowest = endpoint.kind == Endpoint::Kind::udp_listen ? 0 : 1;
  if (!number || *number < lowest || *number > 65535) refuse(text, "this is no port", "1 to 65535");
  endpoint.host = std::move(where);
  endpoint.port = static_cast<std::uint16_t>(*number);
  return endpoint;
}

std::string to_string(const Endpoint& endpoint) {
  if (endpoint.kind == Endpoint::Kind::serial) {
    return "serial:" + endpoint.device + ":" + std::to_string(endpoint.baud);
  }
  const char* kind = endpoint.kind == Endpoint::Kind::udp_listen ? "udpin:"
                     : endpoint.kind == Endpoint::Kind::udp_send ? "udpout:"
                                                                 : "tcp:";
  const bool brackets = endpoint.host.find(':') != std::string::npos;
  return kind + (brackets ? "[" + endpoint.host + "]" : endpoint.host) + ":" + std::to_string(endpoint.port);
}

}  // namespace nadir
