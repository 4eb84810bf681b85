// The byte transport of the autopilot link, named by an endpoint:
//   udpin:HOST:PORT    listen, and answer the peer alone (follow_sender())
//   udpout:HOST:PORT   send first
//   tcp:HOST:PORT      connect
//   serial:PATH:BAUD   a serial port: 8 data bits, no parity, no flow control
// Hosts are addresses ("127.0.0.1", "[::1]") or "localhost": an aircraft does not wait for a name server.
//
// Nothing here blocks: poll() on descriptor() and events(), then call advance(). A transport that is down is reopened
// every second; frames sent meanwhile are dropped, because a stale fix is worse than none. Frames that cannot be
// written at once wait in a bounded buffer, complete frames or nothing.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <string_view>

#include "base/bytes.hpp"

namespace nadir {

struct Endpoint {
  enum class Kind { udp_listen, udp_send, tcp, serial };
  Kind kind = Kind::udp_listen;
  std::string host{};      // without brackets
  std::uint16_t port = 0;  // 0 with udpin only: any free port
  std::string device{};
  int baud = 0;

  bool operator==(const Endpoint&) const = default;
};

// Throws UsageError.
Endpoint parse_endpoint(std::string_view text);
std::string to_string(const Endpoint& endpoint);

struct TransportCounts {
  std::uint64_t bytes_in = 0;
  std::uint64_t bytes_out = 0;
  std::uint64_t frames_dropped = 0;  // no connection, no peer, or the buffer was full
  std::uint64_t opened = 0;
  std::uint64_t lost = 0;
};

// An autopilot that reboots or changes its address is back within this time; its heartbeat comes every second.
inline constexpr std::int64_t kPeerSilence_us = 5'000'000;

class Transport {
 public:
  // `whole`: a datagram, which holds complete frames. `lost`: the connection ended; bytes is empty.
  struct Arrival {
    ByteView bytes;
    bool whole = false;
    bool lost = false;
  };
  using Sink = std::function<void(const Arrival&)>;

  virtual ~Transport() = default;

  // Opens when due, writes the buffer, passes on what arrived (at most about 64 KiB per call). False: there may be
  // more.
  virtual bool advance(std::int64_t monotonic_us, const Sink& sink) = 0;

  // False: dropped, and counted.
  virtual bool send(ByteView frame) = 0;

  // The sender of the arrival that the sink is handling is the peer that this link serves: send to it from now on. A
  // peer whose last frame is younger than kPeerSilence_us keeps its place, whoever else claims it: frames can be forged
  // on an unsigned link, and relayed from another address on a signed one. False: such a rival. Only udpin depends on
  // it.
  virtual bool follow_sender(std::int64_t /*monotonic_us*/) { return true; }

  // To the sender of the arrival that the sink is handling, who does not become the peer by it.
  virtual bool answer_sender(ByteView frame) { return send(frame); }

  virtual bool is_open() const = 0;
  virtual int descriptor() const = 0;  // -1: closed, call advance() again within a second
  virtual short events() const = 0;    // for poll()
  virtual std::uint16_t local_port() const { return 0; }

  const TransportCounts& counts() const { return counts_; }
  const std::string& last_error() const { return last_error_; }  // why it is closed

 protected:
  TransportCounts counts_;
  std::string last_error_;
};

std::unique_ptr<Transport> make_transport(const Endpoint& endpoint);

}  // namespace nadir
