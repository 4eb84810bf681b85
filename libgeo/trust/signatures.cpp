#include "trust/signatures.hpp"

#include <fmt/format.h>

#include "base/error.hpp"
#include "trust/aircraft_state.hpp"
#include "trust/signed_document.hpp"

namespace nadir {
namespace {

// Why a signature does not count; nullopt when it does.
std::optional<Finding> rejection_of(const TrustRoot& root, const Role& role, const EnvelopeSignature& signature,
                                    ByteView signed_bytes, std::optional<UtcTime> at) {
  const auto known = root.keys.find(signature.keyid);
  if (root.revoked.contains(signature.keyid)) {
    return Finding{.code = "key.revoked",
                   .expected = "a key that is still trusted",
                   .found = fmt::format("key {}, which root version {} revokes", signature.keyid, root.version),
                   .fix = "sign again with a key that is not revoked"};
  }
  if (known == root.keys.end() || !role.key_ids.contains(signature.keyid)) {
    return Finding{.code = "key.unknown",
                   .expected = "a key to which the trust root gives this role",
                   .found = "key " + signature.keyid,
                   .fix = "check where this comes from; if its makers have a newer trust root, use that"};
  }
  if (!known->second.key.verifies(signed_bytes, signature.signature)) {
    return Finding{.code = "signature.invalid",
                   .expected = "the bytes that key " + signature.keyid + " signed",
                   .found = "different bytes, or a damaged signature",
                   .fix = "get it again from its makers"};
  }
  if (at && known->second.expires && *known->second.expires <= *at) {
    return Finding{.code = "key.expired",
                   .expected = "a key that is valid at " + to_rfc3339(*at),
                   .found = fmt::format("key {}, expired {}", signature.keyid, to_rfc3339(*known->second.expires)),
                   .fix = "if the clock is right, sign again with a key that has not expired"};
  }
  return std::nullopt;
}

}  // namespace

SignatureCheck check_signatures(const TrustRoot& root, const Role& role,
                                const std::vector<EnvelopeSignature>& signatures, std::string_view payload_type,
                                ByteView body, std::optional<UtcTime> at, std::string_view where) {
  SignatureCheck check;
  const Bytes signed_bytes = pre_authentication_encoding(payload_type, body);
  std::vector<Finding> rejections;
  std::set<std::string> good;  // a key counts once, however often it signed
  for (const EnvelopeSignature& signature : signatures) {
    if (auto finding = rejection_of(root, role, signature, signed_bytes, at)) {
      finding->where = where;
      rejections.push_back(std::move(*finding));
    } else {
      good.insert(signature.keyid);
    }
  }
  const bool enough = good.size() >= role.threshold;
  for (Finding& finding : rejections) {
    if (enough && finding.code != "signature.invalid") finding.severity = Severity::warning;
    check.findings.add(std::move(finding));
  }
  if (!enough && (rejections.empty() || !good.empty())) {
    check.findings.add({.code = "signature.missing",
                        .where = std::string(where),
                        .expected = fmt::format("signatures by {} trusted keys", role.threshold),
                        .found = fmt::format("signatures by {}", good.size()),
                        .fix = "let more of the keys that have this role sign"});
  }
  check.signers.assign(good.begin(), good.end());
  return check;
}

SignatureCheck check_tile_signatures(const TrustRoot& root, const std::string& airframe,
                                     const std::vector<EnvelopeSignature>& signatures, std::string_view payload_type,
                                     ByteView body, std::optional<UtcTime> at, std::string_view where) {
  const auto role = root.tile_signers.find(airframe);
  if (role != root.tile_signers.end()) {
    return check_signatures(root, role->second, signatures, payload_type, body, at, where);
  }
  // Revoking an airframe's last key removes the airframe from the root: report that reason.
  for (const EnvelopeSignature& signature : signatures) {
    if (root.revoked.contains(signature.keyid)) {
      return check_signatures(root, Role(), signatures, payload_type, body, at, where);
    }
  }
  SignatureCheck check;
  check.findings.add({.code = "key.unknown",
                      .where = std::string(where),
                      .expected = "an airframe to which the trust root gives tile signers",
                      .found = "airframe " + airframe,
                      .fix = "name its key in the next root: nadir keys root --tile-signer"});
  return check;
}

namespace {

constexpr const char* kFix = "provision the aircraft again, signed by a key that the root trusts";

Finding unsigned_airframe(const TrustRoot& root, UnsignedAirframe without, std::string_view where) {
  const bool refused = root.airframe_signer && without != UnsignedAirframe::allowed;
  return {.code = "airframe.unsigned",
          .severity = refused ? Severity::error : Severity::warning,
          .where = std::string(where),
          .expected = "a signature beside the airframe's file",
          .found = "none",
          .fix = refused ? "sign it (nadir provision), or on the bench: --unsigned-airframe"
                         : "sign it (nadir provision), and name its signers in the root: nadir keys root "
                           "--airframe-signer"};
}

}  // namespace

Findings check_airframe(const TrustRoot& root, ByteView airframe, const std::optional<Bytes>& envelope, UtcTime at,
                        UnsignedAirframe without, std::string_view where) {
  Findings findings;
  if (!envelope) {
    findings.add(unsigned_airframe(root, without, where));
    return findings;
  }
  const auto invalid = [&](std::string expected, std::string found) {
    findings.add({.code = "signature.invalid",
                  .where = std::string(where),
                  .expected = std::move(expected),
                  .found = std::move(found),
                  .fix = kFix});
  };
  try {
    const Envelope read = parse_envelope(as_text(*envelope), where);
    if (read.payload_type != kAirframePayloadType) {
      invalid("payload type " + std::string(kAirframePayloadType), read.payload_type.substr(0, 80));
      return findings;
    }
    const Role& role = root.airframe_signer ? *root.airframe_signer : root.package_signer;
    findings.add(check_signatures(root, role, read.signatures, kAirframePayloadType, airframe, at, where).findings);
  } catch (const Error& error) {
    invalid(error.text().expected.empty() ? "a signature envelope" : error.text().expected,
            error.text().found.empty() ? error.text().what : error.text().found);
  }
  return findings;
}

Findings check_airframe_age(const AirframeFileAge& file, const AircraftState* state, UtcTime at,
                            std::string_view where) {
  Findings findings;
  std::int64_t accepted = 0;
  if (state != nullptr) {
    const auto remembered = state->airframe_sequence.find(file.airframe);
    if (remembered != state->airframe_sequence.end()) accepted = remembered->second;
  }
  if (file.sequence.value_or(0) < accepted) {
    findings.add(
        {.code = "airframe.rollback",
         .where = std::string(where),
         .expected = fmt::format("sequence {} or higher, because this aircraft has accepted {}", accepted, accepted),
         .found = file.sequence ? fmt::format("sequence {}", *file.sequence) : "no sequence",
         .fix = fmt::format("put the newest file back, or provision the aircraft again with --sequence {}",
                            accepted + 1)});
  }
  if (file.expires && *file.expires <= at) {
    findings.add({.code = "airframe.expired",
                  .where = std::string(where),
                  .expected = "an airframe file that is valid at " + to_rfc3339(at),
                  .found = "expired " + to_rfc3339(*file.expires),
                  .fix = "if the clock is right, provision the aircraft again with a later --expires"});
  }
  if (!file.sequence || !file.expires) {
    findings.add(
        {.code = "airframe.undated",
         .severity = Severity::warning,
         .where = std::string(where),
         .expected = "a sequence and an end of validity",
         .found = file.sequence  ? "no end of validity"
                  : file.expires ? "no sequence"
                                 : "neither",
         .fix = "provision the aircraft again with --sequence and --expires; the next release rejects such files"});
  }
  return findings;
}

}  // namespace nadir
