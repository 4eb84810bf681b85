// manifest.json: the exact bytes that are signed. It names every file of a package with size and SHA-256, for tile
// sets also the number of tiles and their Merkle root, and states for which mission, series and airframes it is.
//
// Integers and strings only, keys sorted; coordinates are whole 1e-7 degrees. schemas/manifest.schema.json is the
// reference, docs/package.md the explanation.
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "base/bytes.hpp"
#include "base/digest.hpp"
#include "base/error.hpp"
#include "base/time.hpp"
#include "geodesy/web_mercator.hpp"
#include "package/mission.hpp"

namespace nadir {

inline constexpr std::string_view kManifestSchema = "nadir.manifest/1";
inline constexpr std::string_view kManifestPayloadType = "application/vnd.nadir.manifest.v1+json";
inline constexpr std::uint64_t kMaxManifestSize = std::uint64_t{1} << 20;

// Names inside every package.
inline constexpr std::string_view kManifestFile = "manifest.json";
inline constexpr std::string_view kSignatureFile = "manifest.sig";
inline constexpr std::string_view kMissionFile = "mission/mission.yaml";
inline constexpr std::string_view kImageryFile = "imagery/base.mbtiles";  // with its sidecars inside, or:
inline constexpr std::string_view kCogFile = "imagery/base.tif";
inline constexpr std::string_view kSidecarFile = "imagery/sidecars.sqlite";  // beside a COG
inline constexpr std::string_view kTerrainFile = "terrain/dem.tif";
inline constexpr std::string_view kMatchabilityFile = "matchability/matchability.tif";
inline constexpr std::string_view kVectorsFile = "vectors/vectors.geojson";

// Roles of artifacts.
inline constexpr std::string_view kRoleImagery = "imagery";
inline constexpr std::string_view kRoleSidecars = "sidecars";  // with a COG
inline constexpr std::string_view kRoleMission = "mission";
inline constexpr std::string_view kRoleTerrain = "terrain";
inline constexpr std::string_view kRoleMatchability = "matchability";
inline constexpr std::string_view kRoleVectors = "vectors";

// What is wrong with the name of a file inside a package; nullopt when nothing is. Names come from a signed document
// and are checked all the same: a name must mean the same file on every file system and must never lead out of the
// package. Good: relative, parts of letters, digits, '.', '_' and '-' joined by single '/', no part beginning with '.'.
inline constexpr std::size_t kMaxPackagePath = 200;
std::optional<std::string> path_problem(std::string_view path);

inline constexpr std::size_t kMaxAttribution = 200;             // bytes
inline constexpr std::size_t kMaxLicence = 64;                  // bytes
inline constexpr std::string_view kUnknownLicence = "unknown";  // said, not left out

// What the licence of a source is that tiles name in their sidecars, and what it asks to be shown.
struct SourceLicence {
  std::string source;       // one name of Sidecar::source
  std::string licence;      // an SPDX identifier, a name ("proprietary"), or kUnknownLicence
  std::string attribution;  // "© survey 2024"; empty: nothing is asked for

  auto operator<=>(const SourceLicence&) const = default;
};

struct TileSetFacts {
  std::uint64_t count = 0;
  Sha256 merkle_root;      // over the tiles' stored digests in the order of TileKey (trust/merkle.hpp)
  Sha256 sidecars_sha256;  // over the sidecar rows (SidecarDigest in sidecar.hpp)
  ZoomRange zoom;
  std::string format;                    // "jpeg", "png", "webp"
  std::vector<SourceLicence> sources{};  // sorted; those whose licence was stated when the package was built
};

// Where vectors come from, and what their licence asks to be shown (package/vector_layer.hpp).
struct VectorFacts {
  std::string attribution;
  std::string licence;   // an SPDX identifier: "ODbL-1.0"
  Sha256 source_sha256;  // of the file that they were cut from
  std::uint64_t roads = 0, water = 0, woods = 0, buildings = 0;

  bool operator==(const VectorFacts&) const = default;
};

struct Artifact {
  std::string path;  // relative, '/' between the parts
  std::string role;
  std::uint64_t size = 0;
  Sha256 sha256;
  std::optional<Sha256> fsverity{};  // of the imagery: what full verification computes (base/fs_verity.hpp)
  std::optional<TileSetFacts> tiles{};
  std::optional<VectorFacts> vectors{};
};

struct Manifest {
  std::string mission_id;
  std::string series;
  std::int64_t sequence = 0;
  UtcTime created;
  UtcTime expires;
  std::vector<std::string> airframes;
  LonLatBox bounds;  // of what the mission requires, outwards to whole 1e-7 degrees
  std::vector<Artifact> artifacts;

  const Artifact* artifact(std::string_view role) const;  // the first of this role, or null
};

// The part of a manifest that follows from the mission; the builder adds the artifacts.
Manifest manifest_for(const Mission& mission);

// Describes a file that is already in the package folder: hashes it; imagery by fs-verity as well.
Artifact describe_file(const std::filesystem::path& package, std::string_view relative_path, std::string_view role);

// The bytes to sign. Artifacts are sorted by path; equal manifests give equal bytes.
std::string manifest_json(Manifest manifest);

// Strict. Findings "manifest.schema" and "manifest.path"; `manifest` is there exactly when nothing is wrong.
struct ManifestReading {
  std::optional<Manifest> manifest;
  Findings findings;
};
ManifestReading parse_manifest(ByteView bytes);

}  // namespace nadir
