#include "trust/root.hpp"

#include <fmt/format.h>

#include "base/error.hpp"
#include "base/files.hpp"
#include "trust/signatures.hpp"

namespace nadir {

void TrustRoot::add_key(const PublicKey& key) { keys.insert_or_assign(key.id(), TrustedKey{key, std::nullopt}); }

TrustRoot read_trusted_root(const std::filesystem::path& path) {
  SignedRoot file = parse_root(read_text_file(path, kMaxRootSize), path.string());
  const Findings findings = check_self(file);
  if (findings.refuses()) {
    const Finding& first = findings.items().front();
    throw Error({.what = "this trust root is not signed by its own keys",
                 .where = path,
                 .expected = first.expected,
                 .found = first.found,
                 .fix = "get the root again from where it was made; do not edit it"});
  }
  return std::move(file.root);
}

Findings check_self(const SignedRoot& root) {
  return check_signatures(root.root, root.root.root, root.signatures, kRootPayloadType, as_bytes(root.signed_bytes),
                          std::nullopt, fmt::format("root version {}", root.root.version))
      .findings;
}

Findings check_succession(const TrustRoot& trusted, const SignedRoot& next) {
  const std::string where = fmt::format("root version {}", next.root.version);
  Findings findings;
  if (next.root.version != trusted.version + 1) {
    findings.add({.code = "root.rollback",
                  .where = where,
                  .expected = fmt::format("version {}", trusted.version + 1),
                  .found = fmt::format("version {}", next.root.version),
                  .fix = "bring the roots between them as well, in order"});
  }
  // Each side counts its own keys: signatures of the other side's keys are no fault.
  const auto by_role = [&](const TrustRoot& judge, const Role& role) {
    std::vector<EnvelopeSignature> own;
    for (const EnvelopeSignature& signature : next.signatures) {
      if (role.key_ids.contains(signature.keyid)) own.push_back(signature);
    }
    findings.add(check_signatures(judge, role, own, kRootPayloadType, as_bytes(next.signed_bytes), std::nullopt, where)
                     .findings);
  };
  by_role(trusted, trusted.root);
  by_role(next.root, next.root.root);
  return findings;
}

}  // namespace nadir
