// Writes the two files that make a folder of artifacts a package, the manifest and, last, its signature; and adds
// artifacts to an existing package, for example a place index: the package appears with them, its manifest and its
// signature in one step, or stays as it was.
#pragma once

#include <filesystem>
#include <functional>
#include <set>
#include <string_view>
#include <vector>

#include "base/error.hpp"
#include "base/progress.hpp"
#include "package/manifest.hpp"
#include "package/mission.hpp"
#include "trust/keys.hpp"

namespace nadir {

// manifest.json. Throws Error when an artifact's path would be refused by a reader.
void write_manifest(const std::filesystem::path& package, const Manifest& manifest);

// manifest.sig over the manifest's exact bytes, with this signature alone.
void sign_package(const std::filesystem::path& package, const PrivateKey& key);

// Adds a signature to those that are there, for thresholds above one; replaces an older one by the same key. Throws
// UsageError when manifest.sig is there but is no envelope of ours. Returns how many signatures there are now.
std::size_t add_package_signature(const std::filesystem::path& package, const PrivateKey& key);

struct Amendment {
  std::set<std::string_view> roles;  // of the added artifacts; existing artifacts of these roles are removed
  // Writes the files into the folder of the new package; returns the artifacts for the manifest.
  std::function<std::vector<Artifact>(const std::filesystem::path& folder)> write;
};

struct AmendedPackage {
  Findings findings;  // refuse: nothing was written
  std::uint64_t bytes = 0;
  std::uint64_t added_bytes = 0;
  bool is_signed = false;
};

// To be called before the work: amending a signed package needs a key. Throws UsageError.
void require_key_when_signed(const std::filesystem::path& package, bool have_key);

// The manifest of a package that is to be amended. Throws UsageError when there is none, Error when it does not read.
Manifest load_package_manifest(const std::filesystem::path& package);

// Makes the new package beside the old one (hard links where the disk has them) and exchanges the two names. A process
// that is killed leaves the old or the new one, and the next run cleans up. manifest, mission: of the package, whose
// files were checked (check_before_signing()). key: null leaves it unsigned. Throws UsageError for a signed package
// without a key.
AmendedPackage amend_package(const std::filesystem::path& package, const Manifest& manifest, const Mission& mission,
                             const Amendment& amendment, const PrivateKey* key, Progress& progress);

}  // namespace nadir
