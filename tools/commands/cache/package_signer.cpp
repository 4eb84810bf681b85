#include "commands/cache/package_signer.hpp"

#include <fmt/format.h>

#include <ostream>

#include "base/error.hpp"
#include "cli/options.hpp"
#include "token_keys/token_key.hpp"

namespace nadir {

void require_package_signer(const PrivateKey& key, const std::optional<TrustRoot>& root,
                            const std::vector<std::filesystem::path>& carried, Context& context) {
  const std::string id = key.public_key().id();
  if (!root) {
    if (!context.quiet) {
      context.err << "note: not checked whether aircraft trust this key: pass --trust ROOT.json\n";
    }
    return;
  }
  const auto known = root->keys.find(id);
  std::string found;
  if (root->revoked.contains(id)) {
    found = "a revoked key";
  } else if (known == root->keys.end() || !root->package_signer.key_ids.contains(id)) {
    found = "a key that this root does not appoint";
  } else if (known->second.expires && *known->second.expires <= context.clock.now()) {
    found = "a key that expired " + to_rfc3339(*known->second.expires);
  }
  if (found.empty()) return;
  if (!carried.empty()) {
    if (!context.quiet)
      context.err << "note: of the installed root this is " << found << "; a carried root may differ\n";
    return;
  }
  throw UsageError({.what = "aircraft would reject a package that is signed with this key",
                    .where = id,
                    .expected = "a package signer of the root of trust",
                    .found = found,
                    .fix = "sign with another key, or appoint this one with `nadir keys root --previous`"});
}

void SigningOptions::setup(Options& options) {
  options.value("--key", key_, "KEY.pem",
                "private key (file or pkcs11: URI) that signs the package; without it the package is unsigned");
  options.values("--carry-root", roots_, "N.root.json", "newer root of trust to add to the package");
  options.value(
      "--trust", trust_, "ROOT.json",
      "root that the aircraft hold: the key must be one of its package signers, and added roots follow from it");
}

SigningOptions::Signing SigningOptions::read(UtcTime at, Context& context) const {
  Signing signing;
  if (key_) signing.key = read_signing_key(*key_);
  std::optional<TrustRoot> installed;
  if (trust_) installed = read_trusted_root(*trust_);
  if (signing.key) require_package_signer(*signing.key, installed, roots_, context);
  signing.roots = read_root_chain(roots_, at, {}, installed ? &*installed : nullptr);
  return signing;
}

}  // namespace nadir
