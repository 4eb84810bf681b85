// The map packages of a desk: the folders of one folder, each verified as the aircraft would verify it when it is first
// asked for, and kept open.
//
// A package that was refused is verified again when its manifest has changed. Safe from several threads; a package that
// is being verified delays nobody who asks for another one that is open.
#pragma once

#include <filesystem>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

#include "base/time.hpp"
#include "estimation/terrain_surface.hpp"
#include "geodesy/local_frame.hpp"
#include "package/open_package.hpp"
#include "vision/place_index.hpp"

namespace nadir {

// A verified package with all that a localizer takes of it. Imagery is read through a reader of one's own
// (OpenPackage::another_imagery_reader).
struct DeskPackage {
  explicit DeskPackage(std::unique_ptr<OpenPackage> accepted, Sha256 manifest_digest);

  std::unique_ptr<const OpenPackage> package;
  Sha256 manifest;  // its digest: a flight goes on with the very package that it was begun with
  LocalFrame frame;
  std::optional<TerrainSurface> surface;
  std::optional<PlaceIndex> places;
  std::unique_ptr<const CheckedTiles> tiles;  // for those who look at the map
};

struct PackageListing {
  std::string name;
  std::shared_ptr<const DeskPackage> package;  // null: refused
  std::string reason;                          // why
};

// Letters, digits, '.', '_' and '-', not hidden, at most 64: a package's name is a folder's.
bool plain_package_name(std::string_view name);

class PackageRegistry {
 public:
  // folder: need not exist. trust: the root for the packages' signatures; without one every package is refused.
  PackageRegistry(std::filesystem::path folder, std::optional<std::filesystem::path> trust,
                  std::function<UtcTime()> now);

  // Nothing when there is no folder of this name.
  std::optional<PackageListing> find(std::string_view name);
  std::vector<PackageListing> list(std::size_t most);  // by name

 private:
  PackageListing verify(const std::string& name) const;

  struct Entry {
    PackageListing listing;
    std::filesystem::file_time_type manifest_written;
  };
  const std::filesystem::path folder_;
  const std::optional<std::filesystem::path> trust_;
  const std::function<UtcTime()> now_;
  std::mutex verifying_;  // one at a time; taken before `mutex_`
  std::mutex mutex_;
  std::map<std::string, Entry, std::less<>> entries_;
};

}  // namespace nadir
