// Is this airframe.json what somebody signed whom we trust? The camera, its mount and the addresses in it decide where
// every position comes out and whom it is told, so it is judged as a package is.
//
// Beside it lies airframe.json.sig, a DSSE envelope with a detached payload (dsse.hpp). Its signers are those of the
// root's role `airframe-signer`; a root without that role takes the package signers.
#pragma once

#include <optional>
#include <string_view>

#include "base/bytes.hpp"
#include "base/finding.hpp"
#include "base/time.hpp"
#include "trust/root.hpp"

namespace nadir {

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
