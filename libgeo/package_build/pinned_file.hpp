// Files that a result was promised from: what a resumed build, or a shard on another machine, must find unchanged.
//
// A pin is the file's path, size, time of change and SHA-256. As rsync and make do, the check looks at size and time
// first: when both are those of the pin, the file counts as unchanged and is not read. A file with another time (a
// copy) is hashed; so a shard reads no more of its imagery than it needs where all machines see one file system.
//
// A pinned object (object_storage/pinned_object.hpp) is checked block by block as it is read, and not before.
#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "base/digest.hpp"
#include "object_storage/pinned_object.hpp"

namespace nadir {

struct PinnedFile {
  std::filesystem::path path;
  std::uint64_t bytes = 0;
  std::int64_t modified_ns = 0;  // since 1970
  Sha256 sha256;
  std::shared_ptr<const ObjectPin> object{};  // of what lies in object storage; the path is its URL
};

PinnedFile pin_file(const std::filesystem::path& path);  // reads all of it. Throws Error

// Every file that the raster is read from: itself, its masks and overviews, the sources of a VRT. Throws UsageError
// when it is not the one that a list states.
std::vector<PinnedFile> pin_raster(const std::filesystem::path& raster, const std::optional<Sha256>& stated = {});

struct PinnedLayer {
  std::filesystem::path path;
  std::vector<PinnedFile> files;
};

// The rasters that an option names (named_rasters()), one layer each.
std::vector<PinnedLayer> pin_rasters(std::span<const std::filesystem::path> named);

// One digest for a raster: over those of its files, in this order.
Sha256 digest_of(std::span<const PinnedFile> files);

// Throws UsageError when one of them is missing or another. since: "the plan was made", for the message.
void require_unchanged(std::span<const PinnedFile> files, const std::string& since);

// Also when a file came to it: to a raster of many (Zarr, tiled assets), or a mask beside one.
void require_unchanged(const PinnedLayer& layer, const std::string& since);

}  // namespace nadir
