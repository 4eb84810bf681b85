#include "mavlink/transport.hpp"

#include "mavlink/stream_transport.hpp"
#include "mavlink/udp_transport.hpp"

namespace nadir {

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
