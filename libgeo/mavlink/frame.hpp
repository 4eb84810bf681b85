// MAVLink frames in a byte stream, versions 1 and 2. A frame is complete and its checksum is valid; signing.hpp checks
// its signature.
//
// After damage the search resumes inside the rejected frame: a corrupt length never costs a frame that follows it.
#pragma once

#include <compare>
#include <cstdint>
#include <optional>

#include "base/bytes.hpp"

namespace nadir {

// Sender or recipient of a message; system 0 and component 0 address everybody.
struct MavlinkAddress {
  std::uint8_t system = 0;
  std::uint8_t component = 0;

  auto operator<=>(const MavlinkAddress&) const = default;
};

inline constexpr std::size_t kMaxFrameSize = 280;
inline constexpr std::size_t kSignatureSize = 13;  // link id, 6 bytes of time, 6 of signature

struct MavlinkFrame {
  Bytes bytes;  // the whole frame, from the start marker to the checksum or the signature
  int version = 2;
  std::uint32_t message_id = 0;
  MavlinkAddress source;
  std::uint8_t sequence = 0;
  bool has_signature = false;
};

struct FrameCounts {
  std::uint64_t frames = 0;
  std::uint64_t bad_crc = 0;
  std::uint64_t unknown = 0;       // message ids without a definition: their checksums cannot be verified
  std::uint64_t incompatible = 0;  // unknown incompatibility flags
  std::uint64_t truncated = 0;     // the datagram or the connection ended inside a frame
  std::uint64_t skipped_bytes = 0;
};

class FrameReader {
 public:
  // Appends to the stream; then call next() until it returns nullopt. Buffers at most one frame beyond what was added.
  void add(ByteView bytes);

  // The next valid frame.
  std::optional<MavlinkFrame> next();

  // The stream ends here (end of a datagram, lost connection): an incomplete frame is dropped. Call next() again until
  // it returns nullopt, because a false start marker may hide valid frames.
  void finish() { finished_ = true; }

  const FrameCounts& counts() const { return counts_; }

 private:
  std::size_t candidate_size() const;
  void skip(std::size_t count);
  void reject(std::uint64_t& count, std::size_t size);
  bool inside_suspect() const { return at_ < suspect_end_; }

  Bytes buffer_;
  std::size_t at_ = 0;
  std::size_t suspect_end_ = 0;  // end of a damaged frame whose length was plausible
  bool finished_ = false;
  FrameCounts counts_;
};

// Turns an unsigned version 2 frame into one that declares a signature: sets the flag and updates the checksum. The
// signature itself (kSignatureSize bytes) must follow.
void mark_signed(Bytes& frame);

}  // namespace nadir
