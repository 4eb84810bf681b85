#include "flight/mission_map.hpp"

#include "estimation/localizer.hpp"

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
