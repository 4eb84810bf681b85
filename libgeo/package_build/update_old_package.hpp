// The package that an update begins with: is it what its makers signed? Whether it may still fly does not matter; that
// its dates are past or its imagery is stale is why it is updated.
#pragma once

#include <filesystem>

#include "base/progress.hpp"
#include "package/package_roots.hpp"
#include "package/verify.hpp"

namespace nadir {

struct OldPackage {
  Findings findings;  // those of verify_package() that say that it is not authentic
  std::optional<Manifest> manifest;
  std::vector<Sidecar> tiles;  // in the order of TileKey
  TrustRoot newest_root;       // that could be reached
  RootChain roots;             // that it carries
};

// Quick depth: tiles are hashed when they are copied. at: when keys and roots must be good.
OldPackage read_old_package(const std::filesystem::path& package, const TrustRoot& trusted, UtcTime at,
                            Progress& progress);

// What an update of this package to this mission cannot do: mission.mismatch for another series or other zooms,
// package.rollback for a sequence that is not higher.
Findings judge_succession(const Manifest& old, const Mission& mission, const std::filesystem::path& mission_file);

// The terrain of the old package, its bytes compared with what was signed; nothing when it has none. Adds
// artifact.hash.
std::optional<std::filesystem::path> old_terrain(const std::filesystem::path& package, const Manifest& manifest,
                                                 Findings& findings);

}  // namespace nadir
