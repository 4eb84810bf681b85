// DSSE (Dead Simple Signing Envelope, v1) with a detached payload: the signature is over
//   "DSSEv1" SP length(type) SP type SP length(body) SP body
// so that neither type nor body can be taken for something else. The envelope file holds everything but the body:
//   {"payloadType": "…", "signatures": [{"keyid": "…", "sig": "base64"}]}
// Source: github.com/secure-systems-lab/dsse, protocol.md.
#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "base/bytes.hpp"
#include "trust/keys.hpp"

namespace nadir {

inline constexpr std::uint64_t kMaxEnvelopeSize = std::uint64_t{1} << 16;
inline constexpr std::size_t kMaxSignatures = 32;

struct EnvelopeSignature {
  std::string keyid;  // 64 hexadecimal digits
  Bytes signature;
};

struct Envelope {
  std::string payload_type;
  std::vector<EnvelopeSignature> signatures;
};

// Pre-authentication encoding: the bytes that are signed.
Bytes pre_authentication_encoding(std::string_view payload_type, ByteView body);

EnvelopeSignature sign_payload(const PrivateKey& key, std::string_view payload_type, ByteView body);

std::string envelope_json(const Envelope& envelope);

// Strict: exactly the members above, canonical base64, no key twice. Throws Error.
Envelope parse_envelope(std::string_view json, std::string_view name);

}  // namespace nadir
