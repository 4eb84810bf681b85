// Who signed: counts the valid signatures of one role over one body, and reports why every other one does not count.
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

struct AircraftState;

struct SignatureCheck {
  Findings findings;  // of severity refuse when there are fewer valid signatures than the role's threshold
  std::vector<std::string> signers;  // key ids
};

// Findings: signature.invalid, signature.missing, key.unknown, key.revoked, key.expired. Once the threshold is met, a
// signature by an unknown, revoked or expired key is a warning; a signature that does not verify is always an error.
// at: nullopt skips the expiry of keys.
SignatureCheck check_signatures(const TrustRoot& root, const Role& role,
                                const std::vector<EnvelopeSignature>& signatures, std::string_view payload_type,
                                ByteView body, std::optional<UtcTime> at, std::string_view where);

// The same for a tile that an airframe made: the keys that the root gives to this airframe, and to no other. An
// airframe without keys in the root: key.revoked when the root revokes the signer, else key.unknown.
SignatureCheck check_tile_signatures(const TrustRoot& root, const std::string& airframe,
                                     const std::vector<EnvelopeSignature>& signatures, std::string_view payload_type,
                                     ByteView body, std::optional<UtcTime> at, std::string_view where);

// airframe.json decides by its camera, mount and addresses where every position comes out and who receives it, so it is
// verified as a package is. Beside it lies airframe.json.sig, a DSSE envelope. Its signers are those of the root's role
// `airframe-signer`; a root without that role accepts the package signers.
inline constexpr std::string_view kAirframePayloadType = "application/vnd.nadir.airframe.v1+json";

enum class UnsignedAirframe {
  refused_when_signers_are_known,  // by a root with the role; by others it is a warning
  allowed,                         // on the bench: a warning
};

// envelope: nullopt when there is none. Findings: airframe.unsigned; signature.invalid, signature.missing, key.unknown,
// key.revoked and key.expired as of check_signatures(), in either case.
Findings check_airframe(const TrustRoot& root, ByteView airframe, const std::optional<Bytes>& envelope, UtcTime at,
                        UnsignedAirframe without, std::string_view where);

// What airframe.json says about itself. Files of before these existed have neither.
struct AirframeFileAge {
  std::string airframe;
  std::optional<std::int64_t> sequence{};
  std::optional<UtcTime> expires{};
};

// A signature stays valid for ever; sequence and end of validity keep somebody from putting an aircraft's earlier file
// back, with the camera or the addresses of then. Findings: airframe.expired; airframe.rollback when this aircraft has
// accepted a higher sequence; airframe.undated, a warning in this release, where one of the two is missing.
// state: nullptr without memory.
Findings check_airframe_age(const AirframeFileAge& file, const AircraftState* state, UtcTime at,
                            std::string_view where);

}  // namespace nadir
