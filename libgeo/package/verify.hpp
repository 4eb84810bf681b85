// Is this package what its producer signed, is it meant for this aircraft, and does it meet its mission's requirements?
//
// The signature comes first; nothing else of the package is looked at before it passes. After that everything that is
// wrong is collected. Codes: docs/findings.md.
#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "base/error.hpp"
#include "base/input_file.hpp"
#include "base/progress.hpp"
#include "base/time.hpp"
#include "imagery/terrain_raster.hpp"
#include "package/manifest.hpp"
#include "package/mission.hpp"
#include "package/sidecar.hpp"
#include "package/tile_set_check.hpp"
#include "trust/aircraft_state.hpp"
#include "trust/rollback_permit.hpp"
#include "trust/root.hpp"
#include "trust/time_permit.hpp"

namespace nadir {

struct VerifyOptions {
  const TrustRoot* root = nullptr;  // required; the caller's trusted root. Newer roots may follow from it
  VerifyDepth depth = VerifyDepth::quick;
  int threads = 1;  // that hash the imagery at full depth
  UtcTime at;
  std::optional<std::string> airframe;            // refuse packages that are not for it
  const AircraftState* state = nullptr;           // refuse what is older than what it has seen
  const SignedPermit* permit = nullptr;           // used when the package is older than what the state has seen
  const SignedTimePermit* time_permit = nullptr;  // used when the clock is earlier than what the state has seen
};

struct Verification {
  Findings findings;
  TrustRoot newest_root;                            // that could be reached
  std::int64_t root_version = 0;                    // its version
  std::map<std::int64_t, std::string> newer_roots;  // documents of those that the state or the package added
  std::vector<std::string> signers;                 // ids of the keys whose signatures are good
  std::optional<Manifest> manifest;                 // once the signature has passed
  std::optional<Mission> mission;
  std::vector<Sidecar> tiles;            // in the order of TileKey
  std::optional<TerrainRaster> terrain;  // with terrain mode dem, at full depth
  std::uint64_t bytes = 0;               // of all artifacts, according to the manifest
  std::optional<UtcTime> time_reset;     // the time to remember instead, as the permit allows
  // The folder that was verified, and its imagery. A path may name another package by now: what is opened after
  // verification is opened beneath this handle.
  std::shared_ptr<const Directory> folder;
  std::shared_ptr<const InputFile> imagery;  // once its size (and, at full depth, its digest) was compared

  bool accepted() const { return manifest.has_value() && !findings.has_errors(); }
};

// Records in the aircraft's state that it accepted this package.
void remember(AircraftState& state, const Verification& accepted, UtcTime at);

// Throws Error when the folder is no package at all or cannot be read.
Verification verify_package(const std::filesystem::path& package, const VerifyOptions& options, Progress& progress);

// A package that was accepted before, by the digest of its manifest: is it still that one, and whole? Files, mission
// and imagery are checked as at quick depth, as of the moment of the acceptance. Clock, signature, dates, root and
// state were judged then and are not asked again: a restart in flight must not judge anew what the aircraft flies with.
Verification verify_accepted_package(const std::filesystem::path& package, const Sha256& manifest, UtcTime accepted_at,
                                     Progress& progress);

// What a signer must know before signing: is every artifact of the manifest in the folder, byte for byte by each of its
// digests, does each tile have the digest that is stored beside it, and does the mission match the manifest? Those who
// verify the package rely on it and compute one of these digests alone (docs/trust.md). Existing signatures are not
// checked. Throws Error when the folder is not a package.
Findings check_before_signing(const std::filesystem::path& package, Progress& progress);

}  // namespace nadir
