#include "flight/mission_map.hpp"

#include <algorithm>

#include "estimation/localizer.hpp"
#include "geodesy/hypotenuse.hpp"

namespace nadir {

MissionMap::MissionMap(std::unique_ptr<OpenPackage> package, const std::filesystem::path& folder)
    : package_(std::move(package)),
      folder_(folder),
      frame_(std::make_shared<const LocalFrame>(mission_frame(package_->mission()))),
      places_(PlaceIndex::open(package_->folder(), package_->manifest())) {
  if (package_->terrain() != nullptr) {
    surface_ = std::make_shared<const TerrainSurface>(*package_->terrain(), *frame_, plane_msl_m());
  }
}

double MissionMap::plane_msl_m() const { return package_->mission().terrain.height_m; }

// In space: the plane of the frame folds the far side of the earth over the near one.
double MissionMap::distance_m(const LonLat& place) const {
  const PlaneBox area = required_region(package_->mission(), *frame_).bounds();
  const PlanePoint at = frame_->plane_from_lonlat(place);
  const LonLat nearest = frame_->lonlat_from_plane(
      {std::clamp(at.east_m, area.west_m, area.east_m), std::clamp(at.north_m, area.south_m, area.north_m)});
  const Enu apart = LocalFrame(nearest).enu_from_geodetic({place, 0});
  return hypotenuse(apart.east_m, apart.north_m, apart.up_m);
}

std::optional<double> MissionMap::ground_msl_m(const LonLat& place) const {
  if (!surface_) return std::nullopt;
  return surface_->msl_m(place);
}

LocalizerConfig MissionMap::config() const {
  LocalizerConfig config;
  config.area = required_region(package_->mission(), *frame_).bounds();
  config.integrity_risk = package_->mission().integrity.risk;
  config.surface = surface_.get();
  config.places = places_ ? &*places_ : nullptr;
  config.matchability = package_->matchability();
  return config;
}

}  // namespace nadir
