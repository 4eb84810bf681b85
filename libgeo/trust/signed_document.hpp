// Signatures over documents, by DSSE (Dead Simple Signing Envelope, v1; github.com/secure-systems-lab/dsse,
// protocol.md). Signed is the pre-authentication encoding
//   "DSSEv1" SP length(type) SP type SP length(body) SP body
// so that neither type nor body can be taken for something else. There are two forms:
//
// An Envelope lies beside the body that it signs and holds everything else (manifest.sig, airframe.json.sig):
//   {"payloadType": "…", "signatures": [{"keyid": "…", "sig": "base64"}]}
//
// A SignedDocument is readable JSON that carries its own signatures (roots, permits, batches):
//   {"signed": {…}, "signatures": [{"keyid", "sig"}]}
// Signed are the bytes of "signed" written without blanks and with sorted keys; the payload type belongs to the kind of
// document.
#pragma once

#include <nlohmann/json_fwd.hpp>
#include <string>
#include <string_view>
#include <vector>

#include "base/bytes.hpp"
#include "trust/keys.hpp"

namespace nadir {

class JsonReader;

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

// The members "keyid" and "sig" of an object. Throws Error.
EnvelopeSignature read_signature(const JsonReader& in);

struct SignedDocument {
  std::string signed_bytes;  // canonical form of "signed"
  std::vector<EnvelopeSignature> signatures;

  std::string json() const;

  // Adds the signature; one of the same key is replaced.
  void put(EnvelopeSignature signature);
};

// Form only. Throws Error for anything but an object with "signed", an object, and "signatures".
SignedDocument split_signed_document(const nlohmann::json& document, std::string_view name);

// The "schema" that the document claims, for callers that accept several kinds; empty when it has none.
std::string claimed_schema(std::string_view text, std::string_view name);

// The same for any list of signatures.
void put_signature(std::vector<EnvelopeSignature>& signatures, EnvelopeSignature signature);

}  // namespace nadir
