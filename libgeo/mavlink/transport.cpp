#include "mavlink/transport.hpp"

#include <arpa/inet.h>
#include <fcntl.h>
#include <fmt/format.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <sys/ioctl.h>
#include <sys/socket.h>
#include <termios.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <cstring>
#include <optional>
#include <string>
#include <utility>

#include "base/error.hpp"
#include "base/number_text.hpp"

namespace nadir {
namespace {

// Owns a file descriptor.
class Descriptor {
 public:
  Descriptor() = default;
  explicit Descriptor(int fd) : fd_(fd) {}
  ~Descriptor() { close(); }
  Descriptor(Descriptor&& other) noexcept : fd_(std::exchange(other.fd_, -1)) {}
  Descriptor& operator=(Descriptor&& other) noexcept {
    if (this != &other) {
      close();
      fd_ = std::exchange(other.fd_, -1);
    }
    return *this;
  }

  int get() const { return fd_; }
  explicit operator bool() const { return fd_ >= 0; }
  void close() {
    if (fd_ >= 0) ::close(fd_);
    fd_ = -1;
  }

 private:
  int fd_ = -1;
};

std::optional<speed_t> serial_speed(int baud) {
  switch (baud) {
    case 9600: return B9600;
    case 19200: return B19200;
    case 38400: return B38400;
    case 57600: return B57600;
    case 115200: return B115200;
    case 230400: return B230400;
    case 460800: return B460800;
    case 500000: return B500000;
    case 921600: return B921600;
    case 1000000: return B1000000;
    case 1500000: return B1500000;
    case 2000000: return B2000000;
    case 3000000: return B3000000;
    default: return std::nullopt;
  }
}

// An address and a port in the form of the socket calls.
struct SocketAddress {
  sockaddr_storage storage{};
  socklen_t size = sizeof(sockaddr_storage);

  sockaddr* get() { return reinterpret_cast<sockaddr*>(&storage); }
  const sockaddr* get() const { return reinterpret_cast<const sockaddr*>(&storage); }
  bool operator==(const SocketAddress& other) const {
    return size == other.size && std::memcmp(&storage, &other.storage, size) == 0;
  }
};

// host is a numeric address, as parse_endpoint() requires.
SocketAddress socket_address(const std::string& host, std::uint16_t port) {
  SocketAddress address;
  sockaddr_in four{};
  if (::inet_pton(AF_INET, host.c_str(), &four.sin_addr) == 1) {
    four.sin_family = AF_INET;
    four.sin_port = htons(port);
    std::memcpy(&address.storage, &four, sizeof four);
    address.size = sizeof four;
    return address;
  }
  sockaddr_in6 six{};
  ::inet_pton(AF_INET6, host.c_str(), &six.sin6_addr);
  six.sin6_family = AF_INET6;
  six.sin6_port = htons(port);
  std::memcpy(&address.storage, &six, sizeof six);
  address.size = sizeof six;
  return address;
}

[[noreturn]] void refuse(std::string_view text, std::string what, std::string expected) {
  throw UsageError({.what = std::move(what),
                    .where = std::string(text),
                    .expected = std::move(expected),
                    .fix = "write, for example, udpin:0.0.0.0:14550 or serial:/dev/ttyAMA0:921600"});
}

bool is_address(const std::string& host) {
  unsigned char bytes[16];
  return ::inet_pton(AF_INET, host.c_str(), bytes) == 1 || ::inet_pton(AF_INET6, host.c_str(), bytes) == 1;
}

}  // namespace

Endpoint parse_endpoint(std::string_view text) {
  const std::size_t first = text.find(':');
  const std::size_t last = text.rfind(':');
  if (first == std::string_view::npos || last == first) {
    refuse(text, "not an autopilot address", "KIND:WHERE:NUMBER");
  }
  const std::string_view kind = text.substr(0, first);
  std::string where(text.substr(first + 1, last - first - 1));
  const std::optional<int> number = whole_number<int>(text.substr(last + 1));

  Endpoint endpoint;
  if (kind == "serial") {
    endpoint.kind = Endpoint::Kind::serial;
    if (!where.starts_with('/')) refuse(text, "the serial port is not an absolute path", "a path such as /dev/ttyAMA0");
    if (!number || !serial_speed(*number))
      refuse(text, "unsupported baud rate", "a standard rate: 57600, 115200, 921600, …");
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
    refuse(text, "unknown kind of link", "udpin, udpout, tcp or serial");
  }
  if (where.starts_with('[') && where.ends_with(']')) {
    where = where.substr(1, where.size() - 2);
  } else if (where.find(':') != std::string::npos) {
    refuse(text, "the address has too many colons", "an IPv6 address in brackets");
  }
  if (where == "localhost") where = "127.0.0.1";
  if (!is_address(where))
    refuse(text, "the host is not a numeric address", "an address such as 192.168.4.1; host names are not resolved");
  const int lowest = endpoint.kind == Endpoint::Kind::udp_listen ? 0 : 1;
  if (!number || *number < lowest || *number > 65535) refuse(text, "invalid port", fmt::format("{} to 65535", lowest));
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

namespace {

constexpr std::int64_t kRetry_us = 1'000'000;
constexpr std::size_t kMaxDatagram = 2048;
constexpr int kDatagramsPerCall = 64;

// Datagrams, each of which holds complete frames.
class UdpTransport final : public Transport {
 public:
  explicit UdpTransport(Endpoint endpoint);

  bool advance(std::int64_t monotonic_us, const Sink& sink) override;
  bool send(ByteView frame) override;
  bool follow_sender(std::int64_t monotonic_us) override;
  bool answer_sender(ByteView frame) override;
  bool is_open() const override { return static_cast<bool>(socket_); }
  int descriptor() const override { return socket_.get(); }
  short events() const override;
  std::uint16_t local_port() const override;

 private:
  void open();
  bool send_to(const std::optional<SocketAddress>& address, ByteView frame);

  Endpoint endpoint_;
  Descriptor socket_;
  std::int64_t retry_us_ = 0;
  SocketAddress sender_;
  std::optional<SocketAddress> peer_;
  std::int64_t peer_seen_us_ = 0;
};

UdpTransport::UdpTransport(Endpoint endpoint) : endpoint_(std::move(endpoint)) {}

void UdpTransport::open() {
  const SocketAddress address = socket_address(endpoint_.host, endpoint_.port);
  Descriptor made(::socket(address.storage.ss_family, SOCK_DGRAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0));
  const bool listens = endpoint_.kind == Endpoint::Kind::udp_listen;
  const int failed = !made     ? -1
                     : listens ? ::bind(made.get(), address.get(), address.size)
                               : ::connect(made.get(), address.get(), address.size);
  if (failed != 0) {
    last_error_ = to_string(endpoint_) + ": " + system_error_text(errno);
    return;
  }
  socket_ = std::move(made);
  last_error_.clear();
  ++counts_.opened;
  if (!listens) peer_ = address;
}

short UdpTransport::events() const { return POLLIN; }

std::uint16_t UdpTransport::local_port() const {
  SocketAddress address;
  if (!socket_ || ::getsockname(socket_.get(), address.get(), &address.size) != 0) return 0;
  return ntohs(address.storage.ss_family == AF_INET6 ? reinterpret_cast<sockaddr_in6*>(address.get())->sin6_port
                                                     : reinterpret_cast<sockaddr_in*>(address.get())->sin_port);
}

bool UdpTransport::advance(std::int64_t monotonic_us, const Sink& sink) {
  if (!socket_) {
    if (monotonic_us < retry_us_) return true;
    retry_us_ = monotonic_us + kRetry_us;
    open();
  }
  std::array<std::uint8_t, kMaxDatagram> buffer;
  for (int i = 0; socket_ && i < kDatagramsPerCall; ++i) {
    sender_ = {};
    const ssize_t got = ::recvfrom(socket_.get(), buffer.data(), buffer.size(), 0, sender_.get(), &sender_.size);
    if (got < 0) {
      // "Connection refused" answers an earlier datagram of ours: the other end is not up yet.
      if (errno == EINTR || errno == ECONNREFUSED) continue;
      if (errno == EAGAIN) return true;
      last_error_ = to_string(endpoint_) + ": " + system_error_text(errno);
      socket_.close();
      ++counts_.lost;
      return true;
    }
    counts_.bytes_in += static_cast<std::uint64_t>(got);
    sink({.bytes = {buffer.data(), static_cast<std::size_t>(got)}, .whole = true});
  }
  return !socket_;
}

bool UdpTransport::follow_sender(std::int64_t monotonic_us) {
  if (endpoint_.kind != Endpoint::Kind::udp_listen) return true;
  if (peer_ && !(*peer_ == sender_) && monotonic_us - peer_seen_us_ < kPeerSilence_us) return false;
  peer_ = sender_;
  peer_seen_us_ = monotonic_us;
  return true;
}

bool UdpTransport::send(ByteView frame) { return send_to(peer_, frame); }

bool UdpTransport::answer_sender(ByteView frame) {
  return send_to(endpoint_.kind == Endpoint::Kind::udp_listen ? sender_ : peer_, frame);
}

bool UdpTransport::send_to(const std::optional<SocketAddress>& address, ByteView frame) {
  if (socket_ && address) {
    const bool listens = endpoint_.kind == Endpoint::Kind::udp_listen;
    const ssize_t sent = listens ? ::sendto(socket_.get(), frame.data(), frame.size(), 0, address->get(), address->size)
                                 : ::send(socket_.get(), frame.data(), frame.size(), 0);
    if (sent == static_cast<ssize_t>(frame.size())) {
      counts_.bytes_out += frame.size();
      return true;
    }
  }
  ++counts_.frames_dropped;
  return false;
}

// A byte stream: TCP and serial ports, which differ in how they are opened.
class StreamTransport final : public Transport {
 public:
  explicit StreamTransport(Endpoint endpoint);

  bool advance(std::int64_t monotonic_us, const Sink& sink) override;
  bool send(ByteView frame) override;
  bool is_open() const override { return fd_ && !connecting_; }
  int descriptor() const override { return fd_.get(); }
  short events() const override;

 private:
  void open(std::int64_t monotonic_us);
  void finish_connecting(std::int64_t monotonic_us, const Sink& sink);
  void write_queued(const Sink& sink);
  void lose(int error, const Sink& sink);

  Endpoint endpoint_;
  Descriptor fd_;
  bool connecting_ = false;
  std::int64_t connect_until_us_ = 0;
  std::int64_t retry_us_ = 0;
  Bytes queue_;
};

constexpr std::int64_t kConnect_us = 3'000'000;
constexpr std::size_t kMaxQueue = 16'384;
constexpr int kReadsPerCall = 16;

// Raw bytes, no flow control. Invalid, with errno set, when it cannot be opened.
Descriptor open_serial(const Endpoint& endpoint) {
  Descriptor port(::open(endpoint.device.c_str(), O_RDWR | O_NOCTTY | O_NONBLOCK | O_CLOEXEC));
  termios settings{};
  if (!port || ::tcgetattr(port.get(), &settings) != 0) return {};
  ::cfmakeraw(&settings);
  settings.c_cflag |= CLOCAL | CREAD;
  settings.c_cflag &= ~static_cast<tcflag_t>(CRTSCTS | HUPCL | CSTOPB);
  settings.c_cc[VMIN] = 1;  // distinguishes "no data" from "hung up"
  settings.c_cc[VTIME] = 0;
  const speed_t speed = serial_speed(endpoint.baud).value_or(B115200);
  ::cfsetispeed(&settings, speed);
  ::cfsetospeed(&settings, speed);
  if (::tcsetattr(port.get(), TCSANOW, &settings) != 0) return {};
  ::ioctl(port.get(), TIOCEXCL);  // exclusive use; not every driver supports it
  ::tcflush(port.get(), TCIFLUSH);
  return port;
}

Descriptor start_connecting(const Endpoint& endpoint) {
  const SocketAddress address = socket_address(endpoint.host, endpoint.port);
  Descriptor made(::socket(address.storage.ss_family, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0));
  if (!made) return {};
  const int on = 1;
  ::setsockopt(made.get(), IPPROTO_TCP, TCP_NODELAY, &on, sizeof on);
  if (::connect(made.get(), address.get(), address.size) != 0 && errno != EINPROGRESS) return {};
  return made;
}

StreamTransport::StreamTransport(Endpoint endpoint) : endpoint_(std::move(endpoint)) {}

short StreamTransport::events() const {
  return static_cast<short>(connecting_ ? POLLOUT : queue_.empty() ? POLLIN : POLLIN | POLLOUT);
}

void StreamTransport::open(std::int64_t monotonic_us) {
  const bool serial = endpoint_.kind == Endpoint::Kind::serial;
  fd_ = serial ? open_serial(endpoint_) : start_connecting(endpoint_);
  if (!fd_) {
    last_error_ = to_string(endpoint_) + ": " + system_error_text(errno);
    return;
  }
  connecting_ = !serial;
  connect_until_us_ = monotonic_us + kConnect_us;
  if (serial) {
    ++counts_.opened;
    last_error_.clear();
  }
}

void StreamTransport::finish_connecting(std::int64_t monotonic_us, const Sink& sink) {
  pollfd ready{fd_.get(), POLLOUT, 0};
  if (::poll(&ready, 1, 0) == 1) {
    int error = 0;
    socklen_t size = sizeof error;
    ::getsockopt(fd_.get(), SOL_SOCKET, SO_ERROR, &error, &size);
    if (error != 0) {
      lose(error, sink);
      return;
    }
    connecting_ = false;
    ++counts_.opened;
    last_error_.clear();
  } else if (monotonic_us > connect_until_us_) {
    lose(ETIMEDOUT, sink);
  }
}

void StreamTransport::lose(int error, const Sink& sink) {
  last_error_ = to_string(endpoint_) + ": " + (error == 0 ? "closed by the peer" : system_error_text(error));
  fd_.close();
  queue_.clear();
  if (!connecting_) {
    ++counts_.lost;
    sink({.bytes = {}, .whole = false, .lost = true});
  }
  connecting_ = false;
}

void StreamTransport::write_queued(const Sink& sink) {
  while (fd_ && !queue_.empty()) {
    const ssize_t written = endpoint_.kind == Endpoint::Kind::tcp
                                ? ::send(fd_.get(), queue_.data(), queue_.size(), MSG_NOSIGNAL)
                                : ::write(fd_.get(), queue_.data(), queue_.size());
    if (written < 0) {
      if (errno == EINTR) continue;
      if (errno != EAGAIN) lose(errno, sink);
      return;
    }
    counts_.bytes_out += static_cast<std::uint64_t>(written);
    queue_.erase(queue_.begin(), queue_.begin() + written);
  }
}

bool StreamTransport::advance(std::int64_t monotonic_us, const Sink& sink) {
  if (!fd_) {
    if (monotonic_us < retry_us_) return true;
    retry_us_ = monotonic_us + kRetry_us;
    open(monotonic_us);
  }
  if (fd_ && connecting_) finish_connecting(monotonic_us, sink);
  if (!is_open()) return true;
  write_queued(sink);
  std::array<std::uint8_t, 4096> buffer;
  for (int i = 0; fd_ && i < kReadsPerCall; ++i) {
    const ssize_t got = ::read(fd_.get(), buffer.data(), buffer.size());
    if (got < 0) {
      if (errno == EINTR) continue;
      if (errno != EAGAIN) lose(errno, sink);
      return true;
    }
    if (got == 0) {
      lose(0, sink);
      return true;
    }
    counts_.bytes_in += static_cast<std::uint64_t>(got);
    sink({.bytes = {buffer.data(), static_cast<std::size_t>(got)}});
  }
  return !fd_;
}

bool StreamTransport::send(ByteView frame) {
  if (!is_open() || queue_.size() + frame.size() > kMaxQueue) {
    ++counts_.frames_dropped;
    return false;
  }
  queue_.insert(queue_.end(), frame.begin(), frame.end());
  // The next advance() reports errors.
  const ssize_t written = endpoint_.kind == Endpoint::Kind::tcp
                              ? ::send(fd_.get(), queue_.data(), queue_.size(), MSG_NOSIGNAL)
                              : ::write(fd_.get(), queue_.data(), queue_.size());
  if (written > 0) {
    counts_.bytes_out += static_cast<std::uint64_t>(written);
    queue_.erase(queue_.begin(), queue_.begin() + written);
  }
  return true;
}

}  // namespace

std::unique_ptr<Transport> make_transport(const Endpoint& endpoint) {
  switch (endpoint.kind) {
    case Endpoint::Kind::udp_listen:
    case Endpoint::Kind::udp_send: return std::make_unique<UdpTransport>(endpoint);
    case Endpoint::Kind::tcp:
    case Endpoint::Kind::serial: break;
  }
  return std::make_unique<StreamTransport>(endpoint);
}

}  // namespace nadir
