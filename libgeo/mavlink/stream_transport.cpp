#include "mavlink/stream_transport.hpp"

#include <fcntl.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <sys/ioctl.h>

#include <array>
#include <cerrno>

#include "base/error.hpp"
#include "mavlink/serial_speed.hpp"
#include "mavlink/socket_address.hpp"

namespace nadir {
namespace {

constexpr std::int64_t kRetryUs = 1'000'000;
constexpr std::int64_t kConnectUs = 3'000'000;
constexpr std::size_t kMaxQueue = 16'384;
constexpr int kReadsPerCall = 16;

// Raw bytes, no flow control. -1 with errno when it cannot be opened.
Descriptor open_serial(const Endpoint& endpoint) {
  Descriptor port(::open(endpoint.device.c_str(), O_RDWR | O_NOCTTY | O_NONBLOCK | O_CLOEXEC));
  termios settings{};
  if (!port || ::tcgetattr(port.get(), &settings) != 0) return {};
  ::cfmakeraw(&settings);
  settings.c_cflag |= CLOCAL | CREAD;
  settings.c_cflag &= ~static_cast<tcflag_t>(CRTSCTS | HUPCL | CSTOPB);
  settings.c_cc[VMIN] = 1;  // so that "nothing there" and "hung up" differ
  settings.c_cc[VTIME] = 0;
  const speed_t speed = serial_speed(endpoint.baud).value_or(B115200);
  ::cfsetispeed(&settings, speed);
  ::cfsetospeed(&settings, speed);
  if (::tcsetattr(port.get(), TCSANOW, &settings) != 0) return {};
  ::ioctl(port.get(), TIOCEXCL);  // nobody else may take our bytes; not every driver knows it
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

}  // namespace

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
  connect_until_us_ = monotonic_us + kConnectUs;
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
  last_error_ = to_string(endpoint_) + ": " + (error == 0 ? "the other end closed it" : system_error_text(error));
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

void StreamTransport::advance(std::int64_t monotonic_us, const Sink& sink) {
  if (!fd_) {
    if (monotonic_us < retry_us_) return;
    retry_us_ = monotonic_us + kRetryUs;
    open(monotonic_us);
  }
  if (fd_ && connecting_) finish_connecting(monotonic_us, sink);
  if (!is_open()) return;
  write_queued(sink);
  std::array<std::uint8_t, 4096> buffer;
  for (int i = 0; fd_ && i < kReadsPerCall; ++i) {
    const ssize_t got = ::read(fd_.get(), buffer.data(), buffer.size());
    if (got < 0) {
      if (errno == EINTR) continue;
      if (errno != EAGAIN) lose(errno, sink);
      return;
    }
    if (got == 0) {
      lose(0, sink);
      return;
    }
    counts_.bytes_in += static_cast<std::uint64_t>(got);
    sink({.bytes = {buffer.data(), static_cast<std::size_t>(got)}});
  }
}

bool StreamTransport::send(ByteView frame) {
  if (!is_open() || queue_.size() + frame.size() > kMaxQueue) {
    ++counts_.frames_dropped;
    return false;
  }
  queue_.insert(queue_.end(), frame.begin(), frame.end());
  // Errors show at the next advance(), which can tell of the loss.
  const ssize_t written = endpoint_.kind == Endpoint::Kind::tcp
                              ? ::send(fd_.get(), queue_.data(), queue_.size(), MSG_NOSIGNAL)
                              : ::write(fd_.get(), queue_.data(), queue_.size());
  if (written > 0) {
    counts_.bytes_out += static_cast<std::uint64_t>(written);
    queue_.erase(queue_.begin(), queue_.begin() + written);
  }
  return true;
}

}  // namespace nadir
