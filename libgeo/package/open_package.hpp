// A package in use: verified once, then read tile by tile, each tile's bytes being hashed and compared with the digest
// that the signature covers. A tile that fails is treated as if it were not there and reported; a flight goes on.
#pragma once

#include <filesystem>
#include <memory>
#include <mutex>
#include <optional>
#include <set>
#include <vector>

#include "imagery/matchability_raster.hpp"
#include "imagery/tile_source.hpp"
#include "package/verify.hpp"

namespace nadir {

class CheckedTiles final : public TileSource {
 public:
  // An MBTiles file or a COG. sidecars: verified, in the order of TileKey.
  CheckedTiles(InputFile tiles, std::vector<Sidecar> sidecars);

  ZoomRange zooms() const override;
  std::optional<Bytes> read(const TileKey& key) const override;
  std::optional<Bytes> read_mask(const TileKey& key) const override;
  std::optional<double> ce90_m(const TileKey& key) const override;

  const Sidecar* sidecar(const TileKey& key) const;
  const std::vector<Sidecar>& sidecars() const { return sidecars_; }

  // What reading has found so far: artifact.hash, sqlite.corrupt, tiff.corrupt. Each tile once, however often it is
  // read.
  Findings findings() const;

 private:
  void report(const char* code, const TileKey& key, std::string found) const;

  std::unique_ptr<TileSource> reader_;
  std::vector<Sidecar> sidecars_;
  mutable std::mutex mutex_;
  mutable Findings findings_;
  mutable std::set<TileKey> reported_;
};

// The tiles of a package whose manifest somebody else vouches for: no signature is checked. Sidecars and addresses are
// compared with the manifest now, each tile when it is read. Null when the findings refuse.
struct CheckedTileSet {
  Findings findings;
  std::unique_ptr<CheckedTiles> tiles;
};
CheckedTileSet open_checked_tiles(const std::filesystem::path& package, const Manifest& manifest, Progress& progress);

// A file of such a package. Throws Error when it has not the digest that the manifest states.
Bytes read_artifact(const std::filesystem::path& package, const Artifact& artifact, std::uint64_t max_size);

class OpenPackage {
 public:
  OpenPackage(Verification accepted, std::optional<MatchabilityRaster> matchability);

  const Manifest& manifest() const { return manifest_; }
  const Mission& mission() const { return mission_; }
  const CheckedTiles& imagery() const { return imagery_; }
  const Directory& folder() const { return *folder_; }  // that was verified, whatever its path names by now
  // The same tiles for another reader, who needs findings of his own.
  std::unique_ptr<CheckedTiles> another_imagery_reader() const;
  const TerrainRaster* terrain() const { return terrain_ ? &*terrain_ : nullptr; }  // null: flat ground
  // The bytes of vectors/vectors.geojson, for pages: read when they are asked for, and compared with the signed digest.
  // Nothing: the package has none, or no longer the signed ones.
  std::optional<Bytes> read_vectors() const;
  // Null: the package has none, or it cannot be read ("matchability.corrupt").
  const MatchabilityRaster* matchability() const { return matchability_ ? &*matchability_ : nullptr; }

 private:
  std::shared_ptr<const Directory> folder_;
  std::shared_ptr<const InputFile> imagery_file_;
  Manifest manifest_;
  Mission mission_;
  CheckedTiles imagery_;
  std::optional<TerrainRaster> terrain_;
  std::optional<MatchabilityRaster> matchability_;
};

// package is null when the findings refuse. Whatever the depth, the terrain is read whole and must have the bytes that
// were signed. A matchability map that cannot be read is a warning: the flight goes on as without one.
struct Opening {
  Findings findings;
  TrustRoot newest_root;  // that could be reached from the one that is trusted
  std::int64_t root_version = 0;
  std::map<std::int64_t, std::string> newer_roots;  // for AircraftState::accept()
  std::optional<UtcTime> time_reset;                // the time to remember instead of a wrong one
  std::unique_ptr<OpenPackage> package;
};
Opening open_package(const std::filesystem::path& package, const VerifyOptions& options, Progress& progress);

// Resumes a flight with what was accepted for it: verify_accepted_package(). Without a root.
Opening open_accepted_package(const std::filesystem::path& package, const Sha256& manifest, UtcTime accepted_at,
                              Progress& progress);

}  // namespace nadir
