#include "ortho/tile_key_check.hpp"

#include "base/error.hpp"

namespace nadir {

void require_tile_key(const TrustRoot& root, const std::string& airframe, const PublicKey& key) {
  const auto role = root.tile_signers.find(airframe);
  const bool given = role != root.tile_signers.end() && role->second.key_ids.contains(key.id());
  if (given && !root.revoked.contains(key.id())) return;
  throw UsageError(
      {.what = given ? "this tile key is revoked" : "the trust root does not give this tile key to the airframe",
       .where = "key " + key.id(),
       .expected = "a tile-signer of airframe " + airframe,
       .fix = "nadir keys root --tile-signer " + airframe + "=KEY.pub.pem makes a root that does"});
}

void require_tile_key(const std::filesystem::path& root_file, const std::string& airframe, const PublicKey& key) {
  require_tile_key(read_trusted_root(root_file), airframe, key);
}

}  // namespace nadir
