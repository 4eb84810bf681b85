#include "mavlink/udp_transport.hpp"

#include <poll.h>

#include <array>
#include <cerrno>

#include "base/error.hpp"

namespace nadir {
namespace {

constexpr std::int64_t kRetryUs = 1'000'000;
constexpr std::size_t kMaxDatagram = 2048;
constexpr int kDatagramsPerCall = 64;

}  // namespace

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

void UdpTransport::advance(std::int64_t monotonic_us, const Sink& sink) {
  if (!socket_) {
    if (monotonic_us < retry_us_) return;
    retry_us_ = monotonic_us + kRetryUs;
    open();
  }
  std::array<std::uint8_t, kMaxDatagram> buffer;
  for (int i = 0; socket_ && i < kDatagramsPerCall; ++i) {
    sender_ = {};
    const ssize_t got = ::recvfrom(socket_.get(), buffer.data(), buffer.size(), 0, sender_.get(), &sender_.size);
    if (got < 0) {
      // "Connection refused" is the network's answer to a datagram of ours: the other end is not up yet.
      if (errno == EINTR || errno == ECONNREFUSED) continue;
      if (errno == EAGAIN) return;
      last_error_ = to_string(endpoint_) + ": " + system_error_text(errno);
      socket_.close();
      ++counts_.lost;
      return;
    }
    counts_.bytes_in += static_cast<std::uint64_t>(got);
    sink({.bytes = {buffer.data(), static_cast<std::size_t>(got)}, .whole = true});
  }
}

void UdpTransport::trust_sender() {
  if (endpoint_.kind == Endpoint::Kind::udp_listen) peer_ = sender_;
}

bool UdpTransport::send(ByteView frame) {
  if (socket_ && peer_) {
    const bool listens = endpoint_.kind == Endpoint::Kind::udp_listen;
    const ssize_t sent = listens ? ::sendto(socket_.get(), frame.data(), frame.size(), 0, peer_->get(), peer_->size)
                                 : ::send(socket_.get(), frame.data(), frame.size(), 0);
    if (sent == static_cast<ssize_t>(frame.size())) {
      counts_.bytes_out += frame.size();
      return true;
    }
  }
  ++counts_.frames_dropped;
  return false;
}

}  // namespace nadir
