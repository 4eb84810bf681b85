#include "ortho/tile_key_check.hpp"

#include <fmt/format.h>

#include "base/error.hpp"

namespace nadir {
namespace {

// The role that the root does give to the key: usually two key files were confused.
std::string other_role(const TrustRoot& root, const std::string& id) {
  if (root.package_signer.key_ids.contains(id)) return "a package signer's";
  if (root.root.key_ids.contains(id)) return "a root key";
  if (root.airframe_signer && root.airframe_signer->key_ids.contains(id)) return "an airframe signer's";
  for (const auto& [airframe, role] : root.tile_signers) {
    if (role.key_ids.contains(id)) return "the tile key of airframe " + airframe;
  }
  return "not in the trust root";
}

}  // namespace

Findings check_tile_key(const TrustRoot& root, const std::string& airframe, const PublicKey& key,
                        std::optional<UtcTime> at, std::string_view where) {
  const std::string id = key.id();
  const auto role = root.tile_signers.find(airframe);
  const bool given = role != root.tile_signers.end() && role->second.key_ids.contains(id);
  const auto known = root.keys.find(id);
  Findings findings;
  if (root.revoked.contains(id)) {
    findings.add({.code = "key.revoked",
                  .where = std::string(where),
                  .expected = "a tile key that is not revoked",
                  .found = fmt::format("key {}, which root version {} revokes", id, root.version),
                  .fix = "give the airframe a new tile key and add it to the next root"});
  } else if (!given || known == root.keys.end()) {
    findings.add({.code = "key.unknown",
                  .where = std::string(where),
                  .expected = "a tile-signer of airframe " + airframe,
                  .found = fmt::format("key {}, {}", id, other_role(root, id)),
                  .fix = "nadir keys root --tile-signer " + airframe + "=KEY.pub.pem creates a root that contains it"});
  } else if (at && known->second.expires && *known->second.expires <= *at) {
    findings.add({.code = "key.expired",
                  .where = std::string(where),
                  .expected = "a tile key that is valid at " + to_rfc3339(*at),
                  .found = fmt::format("key {}, expired {}", id, to_rfc3339(*known->second.expires)),
                  .fix = "give the airframe a new tile key and add it to the next root"});
  }
  return findings;
}

void require_tile_key(const TrustRoot& root, const std::string& airframe, const PublicKey& key) {
  const Findings findings = check_tile_key(root, airframe, key, std::nullopt, {});
  if (findings.empty()) return;
  const Finding& finding = findings.items().front();
  throw UsageError({.what = finding.code == "key.revoked"
                                ? "the tile key is revoked"
                                : "the trust root does not give this tile key to the airframe",
                    .where = "key " + key.id(),
                    .expected = finding.expected,
                    .found = finding.found,
                    .fix = finding.fix});
}

void require_tile_key(const std::filesystem::path& root_file, const std::string& airframe, const PublicKey& key) {
  require_tile_key(read_trusted_root(root_file), airframe, key);
}

}  // namespace nadir
