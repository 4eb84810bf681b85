// Who signed? Counts the good signatures of one role over one body, and says about every other one why it does not
// count.
#pragma once

#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "base/bytes.hpp"
#include "base/error.hpp"
#include "base/time.hpp"
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

// Is this airframe.json what somebody signed whom we trust? The camera, its mount and the addresses in it decide where
// every position comes out and whom it is told, so it is judged as a package is.
//
// Beside it lies airframe.json.sig, a DSSE envelope with a detached payload (dsse.hpp). Its signers are those of the
// root's role `airframe-signer`; a root without that role takes the package signers.

inline constexpr std::string_view kAirframePayloadType = "application/vnd.nadir.airframe.v1+json";

enum class UnsignedAirframe {
  refused_when_signers_are_known,  // by a root with the role; by others it is a warning
  allowed,                         // on the bench: a warning
};

// envelope: nullopt when there is none. Findings: airframe.unsigned; signature.invalid, signature.missing, key.unknown,
// key.revoked and key.expired as of check_signatures(), whatever is allowed.
Findings check_airframe(const TrustRoot& root, ByteView airframe, const std::optional<Bytes>& envelope, UtcTime at,
                        UnsignedAirframe without, std::string_view where);

}  // namespace nadir
