#include "trust/signatures.hpp"

#include <fmt/format.h>

namespace nadir {
namespace {

// Why a signature does not count; nullopt when it does.
std::optional<Finding> objection(const TrustRoot& root, const Role& role, const EnvelopeSignature& signature,
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
                   .fix = "check who made this, or use the trust root of its makers"};
  }
  if (!known->second.key.verifies(signed_bytes, signature.signature)) {
    return Finding{.code = "signature.invalid",
                   .expected = "the bytes that key " + signature.keyid + " signed",
                   .found = "other bytes, or a damaged signature",
                   .fix = "get the package again from its makers"};
  }
  if (at && known->second.expires && *known->second.expires <= *at) {
    return Finding{.code = "key.expired",
                   .expected = "a key that is valid at " + to_rfc3339(*at),
                   .found = fmt::format("key {}, expired {}", signature.keyid, to_rfc3339(*known->second.expires)),
                   .fix = "sign again with a key that has not expired"};
  }
  return std::nullopt;
}

}  // namespace

SignatureCheck check_signatures(const TrustRoot& root, const Role& role,
                                const std::vector<EnvelopeSignature>& signatures, std::string_view payload_type,
                                ByteView body, std::optional<UtcTime> at, std::string_view where) {
  SignatureCheck check;
  const Bytes signed_bytes = pre_authentication_encoding(payload_type, body);
  std::vector<Finding> objections;
  std::set<std::string> good;  // a key counts once, however often it signed
  for (const EnvelopeSignature& signature : signatures) {
    if (auto finding = objection(root, role, signature, signed_bytes, at)) {
      finding->where = where;
      objections.push_back(std::move(*finding));
    } else {
      good.insert(signature.keyid);
    }
  }
  const bool enough = good.size() >= role.threshold;
  for (Finding& finding : objections) {
    if (enough && finding.code != "signature.invalid") finding.severity = Severity::warning;
    check.findings.add(std::move(finding));
  }
  if (!enough && (objections.empty() || !good.empty())) {
    check.findings.add({.code = "signature.missing",
                        .where = std::string(where),
                        .expected = fmt::format("signatures by {} trusted keys", role.threshold),
                        .found = fmt::format("{}", good.size()),
                        .fix = "let more of the signers sign"});
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
  // Whoever revokes an airframe's last key takes the airframe out of the root: then that is the reason.
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

}  // namespace nadir
