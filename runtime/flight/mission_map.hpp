// The package of a flight as the localizer uses it: the plane of the estimates, the map, the terrain, the place index
// and the area in which the aircraft may be.
#pragma once

#include <filesystem>
#include <memory>
#include <optional>

#include "api/opened_package.hpp"
#include "estimation/localizer.hpp"
#include "estimation/terrain_surface.hpp"
#include "package/open_package.hpp"
#include "vision/place_index.hpp"

namespace nadir {

class MissionMap {
 public:
  MissionMap(std::unique_ptr<OpenPackage> package, const std::filesystem::path& folder);
  MissionMap(const MissionMap&) = delete;
  MissionMap& operator=(const MissionMap&) = delete;

  const OpenPackage& package() const { return *package_; }
  const std::filesystem::path& folder() const { return folder_; }
  const LocalFrame& frame() const { return *frame_; }
  LocalizerConfig config() const;  // points into this
  const IntegrityRequirement& integrity() const { return package_->mission().integrity; }
  double plane_msl_m() const;                                     // reference of the surface's heights
  double distance_m(const LonLat& place) const;                   // to the area where the flight can be; 0 within it
  std::optional<double> ground_msl_m(const LonLat& place) const;  // nullopt: flat ground

  ApiPackage for_api() const { return package_for_api(package_); }

 private:
  std::shared_ptr<const OpenPackage> package_;
  std::filesystem::path folder_;
  std::shared_ptr<const LocalFrame> frame_;
  std::shared_ptr<const TerrainSurface> surface_;  // null: flat
  std::optional<PlaceIndex> places_;
};

}  // namespace nadir
