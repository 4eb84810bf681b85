// Files with secrets: a file that others than its owner may read is no secret, and that must be fixed, not warned
// about.
#pragma once

#include <filesystem>

namespace nadir {

// Throws UsageError when others than the owner may use the file (mode wider than 0600), Error when it is not there.
void require_private_mode(const std::filesystem::path& path);

}  // namespace nadir
