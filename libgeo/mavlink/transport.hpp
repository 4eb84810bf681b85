// Bytes to and from the autopilot. Nothing here ever waits: poll() on descriptor() and events(), then call advance().
//
// A link that is down is opened again every second; what is to be sent meanwhile is dropped, because an old fix is
// worse than none. What cannot be written at once waits in a bounded buffer, whole frames or nothing.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <string>

#include "base/bytes.hpp"
#include "mavlink/endpoint.hpp"

namespace nadir {

struct TransportCounts {
  std::uint64_t bytes_in = 0;
  std::uint64_t bytes_out = 0;
  std::uint64_t frames_dropped = 0;  // no connection, nobody to send to, or the buffer was full
  std::uint64_t opened = 0;
  std::uint64_t lost = 0;
};

class Transport {
 public:
  // What arrived. `whole`: a datagram, in which frames begin and end. `lost`: a connection ended; there are no bytes.
  struct Arrival {
    ByteView bytes;
    bool whole = false;
    bool lost = false;
  };
  using Sink = std::function<void(const Arrival&)>;

  virtual ~Transport() = default;

  // Opens when it is time, writes what waits, hands over what arrived (at most about 64 KiB for one call).
  virtual void advance(std::int64_t monotonic_us, const Sink& sink) = 0;

  // False: dropped, and counted.
  virtual bool send(ByteView frame) = 0;

  // Whoever sent what the sink is looking at has proved to be the autopilot: answers go there. Only datagrams that come
  // from anybody make a difference.
  virtual void trust_sender() {}

  virtual bool is_open() const = 0;
  virtual int descriptor() const = 0;  // -1: none, call advance() again within a second
  virtual short events() const = 0;    // for poll()
  virtual std::uint16_t local_port() const { return 0; }

  const TransportCounts& counts() const { return counts_; }
  const std::string& last_error() const { return last_error_; }  // why it is not open

 protected:
  TransportCounts counts_;
  std::string last_error_;
};

std::unique_ptr<Transport> make_transport(const Endpoint& endpoint);

}  // namespace nadir
