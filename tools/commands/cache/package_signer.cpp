#include "commands/cache/package_signer.hpp"

#include <fmt/format.h>

#include <ostream>

#include "base/error.hpp"

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

}  // namespace nadir
