#include "candidates/base_maps.hpp"

#include <algorithm>
#include <array>
#include <mutex>

#include "base/error.hpp"
#include "base/files.hpp"
#include "base/input_file.hpp"
#include "base/progress.hpp"
#include "imagery/codecs.hpp"
#include "package/manifest.hpp"
#include "package/open_package.hpp"
#include "package/sidecar.hpp"
#include "package/verify.hpp"

namespace nadir {
namespace fs = std::filesystem;
namespace {

// Findings about a flight that is still to come, and about the clock by which it would be judged.
constexpr std::array kOfFutureFlights{std::string_view("package.expired"), std::string_view("time.untrusted"),
                                      std::string_view("coverage.gap"),    std::string_view("resolution.coarse"),
                                      std::string_view("freshness.stale"), std::string_view("budget.exceeded"),
                                      std::string_view("dem.gap")};

// What keeps the package from being used; nullptr: nothing.
const Finding* objection_in(const Findings& findings) {
  for (const Finding& finding : findings.items()) {
    const auto& ignored = kOfFutureFlights;
    if (finding.severity != Severity::error) continue;
    if (std::find(ignored.begin(), ignored.end(), finding.code) == ignored.end()) return &finding;
  }
  return nullptr;
}

}  // namespace

struct BaseMaps::Package {
  std::unique_ptr<CheckedTiles> tiles;
  mutable std::mutex mutex;  // one reader, several threads
};

BaseMaps::BaseMaps() = default;
BaseMaps::~BaseMaps() = default;
BaseMaps::BaseMaps(BaseMaps&&) noexcept = default;

BaseMaps::BaseMaps(std::span<const fs::path> packages, const TrustRoot& root, UtcTime at) {
  NoProgress silent;
  for (const fs::path& folder : packages) {
    VerifyOptions options;
    options.root = &root, options.at = at;  // quick: each tile is hashed when it is read
    const Bytes manifest = read_file(folder / kManifestFile, kMaxManifestSize);
    Verification verified = verify_package(folder, options, silent);
    const Finding* const objection = objection_in(verified.findings);
    if (objection != nullptr || !verified.manifest) {
      const Finding finding = objection != nullptr ? *objection : Finding();
      throw Error(
          {.what = "this base package cannot be trusted: " + finding.code,
           .where = (folder / finding.where).string(),
           .expected = finding.expected,
           .found = finding.found,
           .fix = "give the package as it was signed, or leave it out of --package; nadir cache verify says more"});
    }
    const ManifestReading named = parse_manifest(manifest);  // by whose digest its flights call it
    if (!named.manifest || manifest_json(*named.manifest) != manifest_json(*verified.manifest)) {
      throw Error({.what = "this base package is being changed",
                   .where = folder,
                   .expected = "the manifest that was verified",
                   .found = "another one",
                   .fix = "start the service again once nothing writes to the package"});
    }
    auto package = std::make_unique<Package>();
    package->tiles = std::make_unique<CheckedTiles>(verified.imagery->duplicate(), std::move(verified.tiles));
    packages_[sha256(manifest)] = std::move(package);
  }
}

std::set<Sha256> BaseMaps::packages() const {
  std::set<Sha256> digests;
  for (const auto& [digest, package] : packages_) digests.insert(digest);
  return digests;
}

std::optional<BaseTile> BaseMaps::tile(const Sha256& manifest, const TileKey& key) const {
  const auto found = packages_.find(manifest);
  if (found == packages_.end()) return std::nullopt;
  const Package& package = *found->second;
  const std::lock_guard lock(package.mutex);
  const Sidecar* sidecar = package.tiles->sidecar(key);
  if (sidecar == nullptr || sidecar->valid_ppm != kWholeTile_ppm) return std::nullopt;
  const auto bytes = package.tiles->read(key);
  if (!bytes) return std::nullopt;
  return BaseTile{.grey = decode_image(*bytes, Colour::grey, "the base package's tile").image,
                  .ce90_mm = sidecar->ce90_mm};
}

}  // namespace nadir
