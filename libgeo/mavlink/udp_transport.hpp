// Datagrams, of which each holds whole frames. See transport.hpp.
#pragma once

#include <optional>

#include "mavlink/descriptor.hpp"
#include "mavlink/socket_address.hpp"
#include "mavlink/transport.hpp"

namespace nadir {

class UdpTransport final : public Transport {
 public:
  explicit UdpTransport(Endpoint endpoint);

  void advance(std::int64_t monotonic_us, const Sink& sink) override;
  bool send(ByteView frame) override;
  void trust_sender() override;
  bool is_open() const override { return static_cast<bool>(socket_); }
  int descriptor() const override { return socket_.get(); }
  short events() const override;
  std::uint16_t local_port() const override;

 private:
  void open();

  Endpoint endpoint_;
  Descriptor socket_;
  std::int64_t retry_us_ = 0;
  SocketAddress sender_;
  std::optional<SocketAddress> peer_;
};

}  // namespace nadir
