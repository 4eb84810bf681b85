// What systemd wants to hear of a service of Type=notify: that it is ready, how it is, that it lives, that it stops.
//
// The protocol of sd_notify(3) over the datagram socket in NOTIFY_SOCKET, without libsystemd. Without such a socket,
// started by hand, nothing is said. A message that cannot be sent is lost: the flight never waits for systemd.
#pragma once

#include <optional>
#include <string>
#include <string_view>

namespace nadir {

class ServiceManager {
 public:
  // socket: a path, or "@name" in the abstract namespace. nullopt: nobody listens. Throws Error for what can be no
  // socket's name.
  explicit ServiceManager(std::optional<std::string> socket);
  ~ServiceManager();
  ServiceManager(const ServiceManager&) = delete;
  ServiceManager& operator=(const ServiceManager&) = delete;

  bool listens() const { return fd_ >= 0; }

  bool ready(std::string_view status) const;   // READY=1; false when it was not sent
  bool status(std::string_view status) const;  // one line for `systemctl status`
  bool alive() const;                          // WATCHDOG=1
  bool stopping(std::string_view status) const;

 private:
  bool send(const std::string& message) const;

  std::string address_;  // as the kernel wants it: a leading NUL for the abstract namespace
  int fd_ = -1;
};

// What systemd set up for this process. Read once, before there are threads.
struct ServiceEnvironment {
  std::optional<std::string> notify_socket;   // NOTIFY_SOCKET
  std::optional<double> watchdog_interval_s;  // WATCHDOG_USEC, when WATCHDOG_PID is absent or ours
};
ServiceEnvironment read_service_environment();

}  // namespace nadir
