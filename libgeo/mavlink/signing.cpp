#include "mavlink/signing.hpp"

#include <openssl/crypto.h>

#include "base/digest.hpp"
#include "mavlink/codec.hpp"

namespace nadir {
namespace {

constexpr std::size_t kTimestampSize = 6;
constexpr std::size_t kTagSize = 6;
constexpr std::uint64_t kOldest = 60 * kSigningTicksPerSecond;

// Holders of the key alone can open streams; a fleet in one network stays far below.
constexpr std::size_t kMaxStreams = 1024;

// signed_part: the frame up to and with the timestamp.
Sha256 digest(const SigningKey& key, ByteView signed_part) {
  Sha256Stream stream;
  stream.update(key.bytes());
  stream.update(signed_part);
  return stream.finish();
}

}  // namespace

Signing::Signing(const SigningKey& key, SigningTime& time, std::uint8_t link_id)
    : key_(key), time_(time), link_id_(link_id) {}

Bytes Signing::sign(Bytes frame, std::int64_t monotonic_us) {
  mark_signed(frame);
  frame.push_back(link_id_);
  const std::uint64_t timestamp = time_.take(monotonic_us);
  for (std::size_t i = 0; i < kTimestampSize; ++i) frame.push_back(static_cast<std::uint8_t>(timestamp >> (8 * i)));
  const Sha256 tag = digest(key_, frame);
  frame.insert(frame.end(), tag.bytes.begin(), tag.bytes.begin() + kTagSize);
  return frame;
}

SignatureVerdict Signing::verdict(const MavlinkFrame& frame, std::int64_t monotonic_us) {
  if (!frame.has_signature) return SignatureVerdict::without;
  const ByteView all = frame.bytes;
  const ByteView tag = all.last(kTagSize);
  if (CRYPTO_memcmp(digest(key_, all.first(all.size() - kTagSize)).bytes.data(), tag.data(), kTagSize) != 0) {
    return SignatureVerdict::wrong;
  }
  const ByteView block = all.last(kSignatureSize);
  std::uint64_t timestamp = 0;
  for (std::size_t i = kTimestampSize; i > 0; --i) timestamp = (timestamp << 8) | block[i];

  const Stream stream{frame.source, block[0]};
  const auto known = streams_.find(stream);
  if (known != streams_.end() && timestamp <= known->second) return SignatureVerdict::replayed;
  if (timestamp + kOldest < time_.now(monotonic_us)) return SignatureVerdict::too_old;
  if (known == streams_.end() && streams_.size() >= kMaxStreams) return SignatureVerdict::too_many_streams;
  streams_[stream] = timestamp;
  time_.adopt(timestamp, monotonic_us);
  return SignatureVerdict::accepted;
}

SignatureVerdict Signing::check(const MavlinkFrame& frame, std::int64_t monotonic_us) {
  const SignatureVerdict result = verdict(frame, monotonic_us);
  switch (result) {
    case SignatureVerdict::accepted: ++counts_.accepted; break;
    case SignatureVerdict::without: ++counts_.without; break;
    case SignatureVerdict::wrong: ++counts_.wrong; break;
    case SignatureVerdict::replayed: ++counts_.replayed; break;
    case SignatureVerdict::too_old: ++counts_.too_old; break;
    case SignatureVerdict::too_many_streams: ++counts_.too_many_streams; break;
  }
  return result;
}

}  // namespace nadir
