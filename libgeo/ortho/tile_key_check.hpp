// Before the first tile is made: whether the candidate service would accept the signatures of this key.
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <string_view>

#include "base/error.hpp"
#include "base/time.hpp"
#include "trust/root.hpp"

namespace nadir {

// One finding at most: key.revoked, key.unknown (for tiles of this airframe; a key of another role or of another
// airframe is none), key.expired. at: nullopt skips the expiry.
Findings check_tile_key(const TrustRoot& root, const std::string& airframe, const PublicKey& key,
                        std::optional<UtcTime> at, std::string_view where);

// Throws UsageError when the root does not give this key to the airframe for tiles, or revokes it.
void require_tile_key(const TrustRoot& root, const std::string& airframe, const PublicKey& key);
void require_tile_key(const std::filesystem::path& root_file, const std::string& airframe, const PublicKey& key);

}  // namespace nadir
