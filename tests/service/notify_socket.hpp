// Plays systemd: a real datagram socket that the service's messages arrive at.
#pragma once

#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include <array>
#include <cstddef>
#include <cstring>
#include <optional>
#include <stdexcept>
#include <string>

#include "support/temporary_folder.hpp"

namespace nadir::test {

class NotifySocket {
 public:
  // name: an address as in NOTIFY_SOCKET; a path in a folder of its own when there is none.
  explicit NotifySocket(const std::string& name = {})
      : address_(name.empty() ? (folder_ / "notify").string() : name),
        fd_(::socket(AF_UNIX, SOCK_DGRAM | SOCK_CLOEXEC, 0)) {
    sockaddr_un own{};
    own.sun_family = AF_UNIX;
    std::memcpy(own.sun_path, address_.data(), address_.size());
    if (own.sun_path[0] == '@') own.sun_path[0] = '\0';
    const auto size = static_cast<socklen_t>(offsetof(sockaddr_un, sun_path) + address_.size());
    if (fd_ < 0 || ::bind(fd_, reinterpret_cast<const sockaddr*>(&own), size) != 0) throw std::runtime_error("bind");
  }
  ~NotifySocket() { ::close(fd_); }
  NotifySocket(const NotifySocket&) = delete;
  NotifySocket& operator=(const NotifySocket&) = delete;

  const std::string& address() const { return address_; }

  // What has arrived already: datagrams of one machine are there when send returns.
  std::optional<std::string> received() const {
    std::array<char, 4096> text{};
    const ssize_t size = ::recv(fd_, text.data(), text.size(), MSG_DONTWAIT);
    if (size < 0) return std::nullopt;
    return std::string(text.data(), static_cast<std::size_t>(size));
  }

 private:
  TemporaryFolder folder_;
  std::string address_;
  int fd_;
};

}  // namespace nadir::test
