// MAVLink frames in a stream of bytes, versions 1 and 2. A frame is whole and its checksum right; whether it is signed
// by somebody whom we know is signing.hpp's matter.
//
// After damage the search goes on inside what was taken for a frame: a wrong length costs no frame that comes after it.
#pragma once

#include <cstdint>
#include <optional>

#include "base/bytes.hpp"
#include "mavlink/messages.hpp"

namespace nadir {

inline constexpr std::size_t kMaxFrameSize = 280;
inline constexpr std::size_t kSignatureSize = 13;  // link id, 6 bytes of time, 6 of signature

struct MavlinkFrame {
  Bytes bytes;  // all of it, from the start mark to the checksum or the signature
  int version = 2;
  std::uint32_t message_id = 0;
  MavlinkAddress source;
  std::uint8_t sequence = 0;
  bool has_signature = false;
};

struct FrameCounts {
  std::uint64_t frames = 0;
  std::uint64_t bad_crc = 0;
  std::uint64_t unknown = 0;       // message ids without a definition: their checksums cannot be judged
  std::uint64_t incompatible = 0;  // flags that we do not know: the frame may mean something else
  std::uint64_t truncated = 0;     // the datagram or the connection ended inside a frame
  std::uint64_t skipped_bytes = 0;
};

class FrameReader {
 public:
  // More of the stream; read next() until it has nothing left. What is kept is never larger than one frame and what
  // was added since.
  void add(ByteView bytes);

  // The next sound frame.
  std::optional<MavlinkFrame> next();

  // The stream ends here (a datagram's end, a lost connection): half a frame waits for nothing. Call next() until it
  // has nothing left, once more, because a false start may hide sound frames.
  void finish() { finished_ = true; }

  const FrameCounts& counts() const { return counts_; }

 private:
  std::size_t candidate_size() const;
  void skip(std::size_t count);
  void reject(std::uint64_t& count, std::size_t size);
  bool inside_suspect() const { return at_ < suspect_end_; }

  Bytes buffer_;
  std::size_t at_ = 0;
  std::size_t suspect_end_ = 0;  // a damaged frame's, when it ends where it should
  bool finished_ = false;
  FrameCounts counts_;
};

}  // namespace nadir
