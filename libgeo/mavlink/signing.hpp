// Signatures of one link (MAVLink 2, mavlink.io/en/guide/message_signing.html): the first 48 bits of
//   SHA-256(key ‖ header ‖ payload ‖ checksum ‖ link id ‖ timestamp)
//
// Refused are frames without a signature where one is required, wrong signatures, timestamps that their stream (system,
// component, link) has reached before, and those more than a minute behind us. What is accepted moves our clock.
#pragma once

#include <cstdint>
#include <map>
#include <tuple>

#include "mavlink/frame.hpp"
#include "mavlink/signing_key.hpp"
#include "mavlink/signing_time.hpp"

namespace nadir {

enum class SignatureVerdict { accepted, without, wrong, replayed, too_old, too_many_streams };

struct SignatureCounts {
  std::uint64_t accepted = 0;
  std::uint64_t without = 0;
  std::uint64_t wrong = 0;
  std::uint64_t replayed = 0;
  std::uint64_t too_old = 0;
  std::uint64_t too_many_streams = 0;
};

class Signing {
 public:
  // time outlives this; links of one aircraft share it.
  Signing(const SigningKey& key, SigningTime& time, std::uint8_t link_id);

  // An encoded version 2 frame becomes a signed one.
  Bytes sign(Bytes frame, std::int64_t monotonic_us);

  SignatureVerdict check(const MavlinkFrame& frame, std::int64_t monotonic_us);

  const SignatureCounts& counts() const { return counts_; }

 private:
  using Stream = std::tuple<MavlinkAddress, std::uint8_t>;
  SignatureVerdict verdict(const MavlinkFrame& frame, std::int64_t monotonic_us);

  SigningKey key_;
  SigningTime& time_;
  std::uint8_t link_id_;
  std::map<Stream, std::uint64_t> streams_;  // the last timestamp of each
  SignatureCounts counts_;
};

}  // namespace nadir
