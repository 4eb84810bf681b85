// Readable JSON that carries its own signatures, for roots and permits:
//   {"signed": {…}, "signatures": [{"keyid", "sig"}]}
// Signed are the bytes of "signed" written without blanks and with sorted keys, in DSSE's pre-authentication encoding
// with the payload type of the kind of document.
#pragma once

#include <nlohmann/json_fwd.hpp>
#include <string>
#include <string_view>
#include <vector>

#include "trust/dsse.hpp"

namespace nadir {

struct SignedDocument {
  std::string signed_bytes;  // canonical form of "signed"
  std::vector<EnvelopeSignature> signatures;

  std::string json() const;

  // Adds it, or puts it in the place of the same key's older one.
  void put(EnvelopeSignature signature);
};

// Form only. Throws Error for anything but an object with "signed", an object, and "signatures".
SignedDocument split_signed_document(const nlohmann::json& document, std::string_view payload_type,
                                     std::string_view name);

// The "schema" that the document claims; empty when it has none. For whoever takes several kinds.
std::string claimed_schema(std::string_view text, std::string_view name);

// Replaces by key, in any list of signatures.
void put_signature(std::vector<EnvelopeSignature>& signatures, EnvelopeSignature signature);

}  // namespace nadir
