// One MAVLink connection: transport, frames, signatures and messages together. For one thread; never blocks. Times are
// those of a steady clock, in microseconds.
#pragma once

#include <functional>
#include <memory>
#include <optional>

#include "mavlink/messages.hpp"
#include "mavlink/signing.hpp"
#include "mavlink/transport.hpp"

namespace nadir {

struct ReceivedMessage {
  MavlinkAddress source;
  bool is_signed = false;  // with a valid signature
  std::int64_t monotonic_us = 0;
  IncomingMessage message;
};

struct LinkCounts {
  FrameCounts frames;
  SignatureCounts signatures;
  TransportCounts transport;
  std::uint64_t rivals = 0;     // frames of the peer's name from another address while the peer is there
  std::uint64_t malformed = 0;  // valid frames with NaN or infinity where a number is required
  std::uint64_t messages = 0;   // passed to the handler
  std::uint64_t sent = 0;
};

class MavlinkLink {
 public:
  // Without `signing` nothing is signed and every frame is accepted: for simulators and the bench. `peer`: the station
  // that this link serves. Messages of others are received, but what we send never follows them
  // (Transport::follow_sender); a rival with the peer's ids at another address is dropped: signatures do not help
  // against a stolen key. nullopt: the sender of the first accepted frame.
  MavlinkLink(std::unique_ptr<Transport> transport, MavlinkAddress own, std::optional<Signing> signing,
              std::optional<MavlinkAddress> peer = std::nullopt);

  // For poll(), and whether the link is up.
  const Transport& transport() const { return *transport_; }

  // Reads and writes what is possible. Frames that the signing rules reject are counted and dropped; `rejected` gets
  // the sender that they claim. Our own frames that a network echoes are dropped too.
  void advance(std::int64_t monotonic_us, const std::function<void(const ReceivedMessage&)>& handle,
               const std::function<void(MavlinkAddress claimed)>& rejected = {});

  // False: dropped because the link is down or its buffer is full.
  bool send(const OutgoingMessage& message, std::int64_t monotonic_us);

  LinkCounts counts() const;

 private:
  void drain(std::int64_t monotonic_us, const std::function<void(const ReceivedMessage&)>& handle,
             const std::function<void(MavlinkAddress)>& rejected);

  std::unique_ptr<Transport> transport_;
  MavlinkAddress own_;
  std::optional<Signing> signing_;
  std::optional<MavlinkAddress> peer_;
  FrameReader reader_;
  std::uint8_t sequence_ = 0;
  LinkCounts counts_;
};

}  // namespace nadir
