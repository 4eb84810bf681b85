#include "desk/package_registry.hpp"

#include <algorithm>
#include <utility>

#include "base/error.hpp"
#include "replay/flight_request.hpp"

namespace nadir {
namespace {

namespace fs = std::filesystem;

constexpr std::size_t kMaxPackageName = 64;

fs::file_time_type written_at(const fs::path& file) {
  std::error_code code;
  return fs::last_write_time(file, code);  // of a missing one: the earliest time
}

std::string reason_of(const Findings& findings) {
  for (const Finding& finding : findings.items()) {
    if (finding.severity != Severity::error) continue;
    return finding.code + (finding.where.empty() ? "" : ": " + finding.where);
  }
  return "refused";
}

}  // namespace

DeskPackage::DeskPackage(std::unique_ptr<OpenPackage> accepted, Sha256 manifest_digest)
    : package(std::move(accepted)),
      manifest(manifest_digest),
      frame(mission_frame(package->mission())),
      places(PlaceIndex::open(package->folder(), package->manifest())),
      tiles(package->another_imagery_reader()) {
  if (package->terrain() != nullptr) {
    surface.emplace(*package->terrain(), frame, package->mission().terrain.height_m);
  }
}

bool plain_package_name(std::string_view name) {
  constexpr std::string_view kAllowed = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789._-";
  return !name.empty() && name.size() <= kMaxPackageName && name.front() != '.' &&
         name.find_first_not_of(kAllowed) == std::string_view::npos;
}

PackageRegistry::PackageRegistry(fs::path folder, std::optional<fs::path> trust, std::function<UtcTime()> now)
    : folder_(std::move(folder)), trust_(std::move(trust)), now_(std::move(now)) {}

PackageListing PackageRegistry::verify(const std::string& name) const {
  PackageListing listing{.name = name, .package = nullptr, .reason = {}};
  if (!trust_) {
    listing.reason = "no root of trust: start the desk with --trust ROOT.json";
    return listing;
  }
  try {
    NoProgress progress;
    const fs::path folder = folder_ / name;
    // The digest of the manifest that was verified: the one that was read before must still be there afterwards.
    const Sha256 manifest = sha256_file(folder / kManifestFile);
    Opening opening =
        open_flight_map({.package = folder, .trust = *trust_, .airframe = std::nullopt}, now_(), progress);
    if (!opening.package) {
      listing.reason = reason_of(opening.findings);
    } else if (sha256(opening.package->folder().open(kManifestFile).read(kMaxManifestSize)) != manifest) {
      listing.reason = "the package was replaced while it was verified";
    } else {
      listing.package = std::make_shared<const DeskPackage>(std::move(opening.package), manifest);
    }
  } catch (const Error& error) {
    listing.reason = error.text().what + (error.text().found.empty() ? "" : ": " + error.text().found);
  }
  return listing;
}

std::optional<PackageListing> PackageRegistry::find(std::string_view name) {
  if (!plain_package_name(name)) return std::nullopt;
  const auto known = [&]() -> std::optional<PackageListing> {
    const std::lock_guard lock(mutex_);
    const auto found = entries_.find(name);
    if (found == entries_.end()) return std::nullopt;
    const Entry& entry = found->second;
    if (entry.listing.package) return entry.listing;
    if (written_at(folder_ / name / kManifestFile) == entry.manifest_written) return entry.listing;
    return std::nullopt;
  };
  if (auto listing = known()) return listing;
  std::error_code code;
  if (!fs::is_directory(folder_ / name, code)) return std::nullopt;
  const std::lock_guard one_at_a_time(verifying_);
  if (auto listing = known()) return listing;  // by somebody who was first
  const fs::file_time_type written = written_at(folder_ / name / kManifestFile);
  PackageListing listing = verify(std::string(name));
  const std::lock_guard lock(mutex_);
  entries_.insert_or_assign(std::string(name), Entry{listing, written});
  return listing;
}

std::vector<PackageListing> PackageRegistry::list(std::size_t most) {
  std::vector<std::string> names;
  std::error_code code;
  for (fs::directory_iterator at(folder_, code), end; !code && at != end; at.increment(code)) {
    const std::string name = at->path().filename().string();
    if (plain_package_name(name) && at->is_directory(code)) names.push_back(name);
  }
  std::sort(names.begin(), names.end());
  if (names.size() > most) names.resize(most);
  std::vector<PackageListing> listings;
  for (const std::string& name : names) {
    if (auto listing = find(name)) listings.push_back(*std::move(listing));
  }
  return listings;
}

}  // namespace nadir
