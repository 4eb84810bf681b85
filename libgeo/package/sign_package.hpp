// Writes the two files that make a folder of artifacts a package: the manifest and, last, its signature.
#pragma once

#include <filesystem>

#include "base/progress.hpp"
#include "package/manifest.hpp"
#include "trust/keys.hpp"

namespace nadir {

// manifest.json. Throws Error when an artifact's path would be refused by a reader.
void write_manifest(const std::filesystem::path& package, const Manifest& manifest);

// manifest.sig over the manifest's exact bytes, with this signature alone.
void sign_package(const std::filesystem::path& package, const PrivateKey& key);

// Adds a signature to those that are there, for thresholds above one; replaces an older one by the same key. Throws
// UsageError when manifest.sig is there but is no envelope of ours. Returns how many signatures there are now.
std::size_t add_package_signature(const std::filesystem::path& package, const PrivateKey& key);

// What a signer must know before signing: does everything that the manifest names lie in the folder, byte for byte, and
// is its mission the one that it holds? Nothing is said about who signed before. Throws Error when this is no package.
Findings check_before_signing(const std::filesystem::path& package, Progress& progress);

}  // namespace nadir
