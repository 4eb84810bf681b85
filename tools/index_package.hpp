// Puts a place index into a package: the package appears with index, manifest and signature in one step, or stays as it
// was.
#pragma once

#include <filesystem>

#include "base/finding.hpp"
#include "base/progress.hpp"
#include "trust/keys.hpp"
#include "vision/place_index.hpp"

namespace nadir {

struct IndexedPackage {
  Findings findings;  // refuse: nothing was written
  std::uint64_t bytes = 0;
  std::uint64_t index_bytes = 0;
  bool is_signed = false;
};

// Makes the new package beside the old one (hard links where the disk has them) and exchanges the two. Throws
// UsageError for a signed package without a key.
IndexedPackage put_index(const std::filesystem::path& package, const Manifest& manifest, const Mission& mission,
                         const PlaceIndex& index, const PrivateKey* key);

// Before the work: a signed package needs a key, and its files have to be those of its manifest.
void require_key_when_signed(const std::filesystem::path& package, bool have_key);

}  // namespace nadir
