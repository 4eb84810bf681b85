// The packages that flights may have flown with, for comparing their tiles with: folders that the operator names. Each
// is verified against the trust root before it is used, and each tile is hashed again when it is read: a map that
// nobody signed decides nothing.
#pragma once

#include <filesystem>
#include <map>
#include <memory>
#include <opencv2/core/mat.hpp>
#include <optional>
#include <set>
#include <span>

#include "base/digest.hpp"
#include "base/time.hpp"
#include "geodesy/web_mercator.hpp"
#include "trust/root.hpp"

namespace nadir {

struct BaseTile {
  cv::Mat grey;              // CV_8UC1, kTileSize square
  std::int64_t ce90_mm = 0;  // of its placement
};

class BaseMaps {
 public:
  BaseMaps();
  ~BaseMaps();
  // Verifies signatures, files and sidecars. What only matters to a flight that is still to come (the package's expiry,
  // its freshness and coverage) does not: its flights are over. Throws Error for a folder that is no package with
  // imagery, or not one that the root's package signers have signed.
  BaseMaps(std::span<const std::filesystem::path> packages, const TrustRoot& root, UtcTime at);
  BaseMaps(BaseMaps&&) noexcept;

  // Whether flights over this package may send candidates: any may where the operator names no packages.
  bool takes(const Sha256& manifest) const { return packages_.empty() || packages_.contains(manifest); }
  std::set<Sha256> packages() const;  // their manifests

  // Whole tiles only. nullopt where the package is not known, or has no such tile. For any thread.
  std::optional<BaseTile> tile(const Sha256& manifest, const TileKey& key) const;

 private:
  struct Package;
  std::map<Sha256, std::unique_ptr<Package>> packages_;
};

}  // namespace nadir
