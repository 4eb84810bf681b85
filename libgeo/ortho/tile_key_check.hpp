// Before the first tile is made: would anybody accept what this key signs?
#pragma once

#include <filesystem>
#include <string>

#include "trust/root.hpp"

namespace nadir {

// Throws UsageError when the root does not give this key to the airframe for tiles, or revokes it.
void require_tile_key(const TrustRoot& root, const std::string& airframe, const PublicKey& key);
void require_tile_key(const std::filesystem::path& root_file, const std::string& airframe, const PublicKey& key);

}  // namespace nadir
