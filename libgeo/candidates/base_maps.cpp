#include "candidates/base_maps.hpp"

#include <mutex>

#include "base/error.hpp"
#include "base/files.hpp"
#include "imagery/codecs.hpp"
#include "package/manifest.hpp"
#include "package/open_package.hpp"
#include "package/sidecar.hpp"
#include "package/tile_container.hpp"

namespace nadir {
namespace fs = std::filesystem;
namespace {

constexpr std::uint64_t kLargestManifest = std::uint64_t{1} << 26;

}  // namespace

struct BaseMaps::Package {
  std::unique_ptr<CheckedTiles> tiles;
  mutable std::mutex mutex;  // one reader, several threads
};

BaseMaps::BaseMaps() = default;
BaseMaps::~BaseMaps() = default;
BaseMaps::BaseMaps(BaseMaps&&) noexcept = default;

BaseMaps::BaseMaps(std::span<const fs::path> packages) {
  for (const fs::path& folder : packages) {
    const Bytes text = read_file(folder / kManifestFile, kLargestManifest);
    const ManifestReading reading = parse_manifest(text);
    const Artifact* imagery = reading.manifest ? reading.manifest->artifact(kRoleImagery) : nullptr;
    if (imagery == nullptr) throw UsageError({.what = "the package has no imagery", .where = folder});
    const fs::path file = folder / imagery->path;
    const auto container = open_tile_container(file);
    if (container->sidecars() == nullptr)
      throw UsageError({.what = "the package's tiles have no sidecars", .where = file});
    auto package = std::make_unique<Package>();
    package->tiles = std::make_unique<CheckedTiles>(InputFile(file), read_sidecars(*container->sidecars()).sidecars);
    packages_[sha256(text)] = std::move(package);
  }
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
