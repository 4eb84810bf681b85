// The steps of verify_package(), each in a file of its own. Inside this folder only.
#pragma once

#include <filesystem>
#include <set>
#include <string>

#include "package/verify.hpp"

namespace nadir {

// Signature over the manifest's exact bytes, then the manifest. Fills signers and manifest; without a manifest
// nothing else may be looked at.
void verify_signature(const std::filesystem::path& package, const TrustRoot& root, const VerifyOptions& options,
                      Verification& result);

// Dates, clock, sequences and the permit to go back, airframe.
Findings verify_policy(const Manifest& manifest, const TrustRoot& root, const VerifyOptions& options);

// The files on disk against the artifacts. Imagery and terrain are hashed at full depth only, everything else
// always.
struct FileCheck {
  Findings findings;
  std::set<std::string> sound;  // paths of artifacts that are there with their size (and, where hashed, their digest)
};
FileCheck verify_files(const std::filesystem::path& package, const Manifest& manifest, VerifyDepth depth,
                       Progress& progress);

// mission.yaml against the manifest. Fills mission.
void verify_mission(const std::filesystem::path& package, Verification& result);

}  // namespace nadir
