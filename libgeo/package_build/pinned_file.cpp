#include "package_build/pinned_file.hpp"

#include <fmt/format.h>
#include <sys/stat.h>

#include <cerrno>
#include <system_error>

#include "base/error.hpp"
#include "base/plural.hpp"
#include "raster/gdal_dataset.hpp"
#include "raster/imagery_input.hpp"
#include "raster/pinned_files.hpp"

namespace nadir {
namespace {

struct FileState {
  std::uint64_t bytes = 0;
  std::int64_t modified_ns = 0;
};

FileState state_of(const std::filesystem::path& path) {
  struct stat info {};
  if (::stat(path.c_str(), &info) != 0) {
    throw Error({.what = "an input cannot be read",
                 .where = path.string(),
                 .found = std::system_category().message(errno),
                 .fix = "every machine must reach the inputs under the same path"});
  }
  constexpr std::int64_t kNsPerS = 1'000'000'000;
  return {static_cast<std::uint64_t>(info.st_size), info.st_mtim.tv_sec * kNsPerS + info.st_mtim.tv_nsec};
}

}  // namespace

PinnedFile pin_file(const std::filesystem::path& path) {
  const FileState state = state_of(path);
  return {std::filesystem::absolute(path), state.bytes, state.modified_ns, sha256_file(path)};
}

std::vector<PinnedFile> pin_raster(const std::filesystem::path& raster, const std::optional<Sha256>& stated) {
  if (const PinnedObject* object = mounted_object(raster)) {
    const ObjectPin& pin = object->pin();
    return {{raster, pin.bytes, 0, pin.sha256, std::make_shared<const ObjectPin>(pin)}};
  }
  std::vector<PinnedFile> files;
  for (const std::filesystem::path& file : files_of_raster(raster)) files.push_back(pin_file(file));
  if (!stated || files.empty() || files.front().sha256 == *stated) return files;
  throw UsageError({.what = "a raster is not the one that its list states",
                    .where = raster.string(),
                    .expected = "sha256 " + stated->hex(),
                    .found = "sha256 " + files.front().sha256.hex(),
                    .fix = "restore the file; or state the new one's file:checksum, if it is wanted"});
}

std::vector<PinnedLayer> pin_rasters(std::span<const std::filesystem::path> named) {
  std::vector<PinnedLayer> layers;
  for (const std::filesystem::path& name : named) {
    for (const StacAsset& asset : named_rasters(name)) {
      const bool is_object = mounted_object(asset.href) != nullptr;
      layers.push_back({is_object ? std::filesystem::path(asset.href) : std::filesystem::absolute(asset.href),
                        pin_raster(asset.href, asset.sha256)});
    }
  }
  return layers;
}

Sha256 digest_of(std::span<const PinnedFile> files) {
  Sha256Stream all;
  for (const PinnedFile& file : files) all.update(ByteView(file.sha256.bytes));
  return all.finish();
}

void require_unchanged(std::span<const PinnedFile> files, const std::string& since) {
  for (const PinnedFile& file : files) {
    if (file.object) continue;
    const auto refuse = [&](std::string expected, std::string found) {
      throw UsageError({.what = "an input has changed since " + since,
                        .where = file.path.string(),
                        .expected = std::move(expected),
                        .found = std::move(found),
                        .fix = "restore the file, or make a new plan"});
    };
    const FileState now = state_of(file.path);
    if (now.bytes != file.bytes) refuse(fmt::format("{} bytes", file.bytes), fmt::format("{} bytes", now.bytes));
    if (now.modified_ns == file.modified_ns) continue;
    const Sha256 digest = sha256_file(file.path);
    if (digest != file.sha256) refuse("sha256 " + file.sha256.hex(), "sha256 " + digest.hex());
  }
}

void require_unchanged(const PinnedLayer& layer, const std::string& since) {
  require_unchanged(layer.files, since);
  if (!layer.files.empty() && layer.files.front().object) return;
  const std::vector<std::filesystem::path> now = files_of_raster(layer.path);
  if (now.size() == layer.files.size()) return;  // each of them is there
  throw UsageError({.what = "an input has changed since " + since,
                    .where = layer.path.string(),
                    .expected = count(layer.files.size(), "file"),
                    .found = count(now.size(), "file"),
                    .fix = "remove what was added, or make a new plan"});
}

}  // namespace nadir
