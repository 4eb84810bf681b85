// One link to the autopilot: a transport, frames, signatures and messages put together. It is used from one thread and
// never waits; time comes from a steady clock, in microseconds.
#pragma once

#include <functional>
#include <memory>
#include <optional>

#include "mavlink/codec.hpp"
#include "mavlink/signing.hpp"
#include "mavlink/transport.hpp"

namespace nadir {

struct ReceivedMessage {
  MavlinkAddress source;
  bool is_signed = false;  // and the signature is right
  std::int64_t monotonic_us = 0;
  IncomingMessage message;
};

struct LinkCounts {
  FrameCounts frames;
  SignatureCounts signatures;
  TransportCounts transport;
  std::uint64_t malformed = 0;  // sound frames whose numbers are none
  std::uint64_t messages = 0;   // handed on
  std::uint64_t sent = 0;
};

class MavlinkLink {
 public:
  // Without `signing` nothing is signed and everything is believed: for simulators and the bench.
  MavlinkLink(std::unique_ptr<Transport> transport, MavlinkAddress own, std::optional<Signing> signing);

  // What poll() needs, and whether the link is there.
  const Transport& transport() const { return *transport_; }

  // Reads and writes what can be. Frames that the signing rules refuse are counted and go no further, but for the news
  // that `refused` gets of who claims to have sent them; so are our own that a network sends back.
  void advance(std::int64_t monotonic_us, const std::function<void(const ReceivedMessage&)>& handle,
               const std::function<void(MavlinkAddress claimed)>& refused = {});

  // False: dropped, because the link is down or full.
  bool send(const OutgoingMessage& message, std::int64_t monotonic_us);

  LinkCounts counts() const;

 private:
  void drain(std::int64_t monotonic_us, const std::function<void(const ReceivedMessage&)>& handle,
             const std::function<void(MavlinkAddress)>& refused);

  std::unique_ptr<Transport> transport_;
  MavlinkAddress own_;
  std::optional<Signing> signing_;
  FrameReader reader_;
  std::uint8_t sequence_ = 0;
  LinkCounts counts_;
};

}  // namespace nadir
