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

  // A challenge: while the peer is not there, frames with its name and a valid signature, but a timestamp that counts
  // as seen, are answered by a heartbeat. They are a recording, or the peer itself after a restart of ours: its
  // timestamps pass with the frames that it sends (ten microseconds each) and not with time, so that on its own it
  // would be behind those that we saved ahead (StreamTimestamps) for an hour. It takes over the time of our heartbeat,
  // as every MAVLink implementation does, and its next frame is newer than whatever was recorded.

  // For poll(), and whether the link is up.
  const Transport& transport() const { return *transport_; }

  // Reads and writes what is possible. Frames that the signing rules reject are counted and dropped; `rejected` gets
  // the sender that they claim. Our own frames that a network echoes are dropped too. False: there may be more to read.
  bool advance(std::int64_t monotonic_us, const std::function<void(const ReceivedMessage&)>& handle,
               const std::function<void(MavlinkAddress claimed)>& rejected = {});

  // False: dropped because the link is down or its buffer is full.
  bool send(const OutgoingMessage& message, std::int64_t monotonic_us);

  LinkCounts counts() const;

 private:
  void drain(std::int64_t monotonic_us, const std::function<void(const ReceivedMessage&)>& handle,
             const std::function<void(MavlinkAddress)>& rejected);
  void challenge(const MavlinkFrame& replayed, std::int64_t monotonic_us);

  std::unique_ptr<Transport> transport_;
  MavlinkAddress own_;
  std::optional<Signing> signing_;
  std::optional<MavlinkAddress> peer_;
  FrameReader reader_;
  std::uint8_t sequence_ = 0;
  std::optional<std::int64_t> accepted_us_;  // the last frame from the peer
  std::int64_t next_challenge_us_ = 0;
  LinkCounts counts_;
};

}  // namespace nadir
