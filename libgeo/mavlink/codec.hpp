// Between frames and messages. Which bytes stand for what is said by the headers that the official generator makes from
// the official definitions; the units of messages.hpp are made here.
#pragma once

#include <cstdint>
#include <optional>

#include "base/bytes.hpp"
#include "mavlink/frame.hpp"
#include "mavlink/messages.hpp"

namespace nadir {

// What a frame says. nullopt: malformed, a number that is none where there must be one. Fields that the sender left out
// (version 2 cuts zeros off, version 1 knows no extensions) are zero or unknown.
std::optional<IncomingMessage> decode(const MavlinkFrame& frame);

// A version 2 frame without a signature; signing.hpp signs it. Numbers out of a field's range are set to its nearest
// end, long texts are cut at a character's end.
Bytes encode(const OutgoingMessage& message, MavlinkAddress from, std::uint8_t sequence);

// Makes an unsigned version 2 frame one that says that it is signed: sets the flag and mends the checksum. The
// signature itself (kSignatureSize bytes) must follow.
void mark_signed(Bytes& frame);

}  // namespace nadir
