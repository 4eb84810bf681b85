#include "trust/airframe_signature.hpp"

#include "base/error.hpp"
#include "trust/dsse.hpp"
#include "trust/signatures.hpp"

namespace nadir {
namespace {

constexpr const char* kFix = "let the aircraft be provisioned anew by whom the root trusts";

Finding unsigned_airframe(const TrustRoot& root, UnsignedAirframe without, std::string_view where) {
  const bool refused = root.airframe_signer && without != UnsignedAirframe::allowed;
  return {.code = "airframe.unsigned",
          .severity = refused ? Severity::refuse : Severity::warning,
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

}  // namespace nadir
