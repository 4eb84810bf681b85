// Who signed? Counts the good signatures of one role over one body, and says about every other one why it does not
// count.
#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "base/finding.hpp"
#include "trust/root.hpp"

namespace nadir {

struct SignatureCheck {
  Findings findings;                 // refuses when fewer good signatures than the role's threshold were found
  std::vector<std::string> signers;  // key ids
};

// Findings: signature.invalid, signature.missing, key.unknown, key.revoked, key.expired. Once the threshold is met, a
// signature by an unknown, revoked or expired key is a warning; a signature that does not verify refuses always.
// at: nullopt skips the expiry of keys.
SignatureCheck check_signatures(const TrustRoot& root, const Role& role,
                                const std::vector<EnvelopeSignature>& signatures, std::string_view payload_type,
                                ByteView body, std::optional<UtcTime> at, std::string_view where);

// The same for a tile that an airframe made: the keys that the root gives to this airframe, and to no other. An
// airframe without keys in the root: key.revoked when the root revokes the signer, else key.unknown.
SignatureCheck check_tile_signatures(const TrustRoot& root, const std::string& airframe,
                                     const std::vector<EnvelopeSignature>& signatures, std::string_view payload_type,
                                     ByteView body, std::optional<UtcTime> at, std::string_view where);

}  // namespace nadir
