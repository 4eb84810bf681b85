// Brings a file or a folder to the disk: what it holds survives a power cut when this returns.
#pragma once

#include <filesystem>

namespace nadir {

void sync_to_disk(const std::filesystem::path& path);  // throws Error

}  // namespace nadir
