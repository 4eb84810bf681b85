// What a flight knows from its package: the plane of its estimates, the map, the ground, and where it may be at all.
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

class FlightGround {
 public:
  FlightGround(std::unique_ptr<OpenPackage> package, const std::filesystem::path& folder);
  FlightGround(const FlightGround&) = delete;
  FlightGround& operator=(const FlightGround&) = delete;

  const OpenPackage& package() const { return *package_; }
  const std::filesystem::path& folder() const { return folder_; }
  const LocalFrame& frame() const { return *frame_; }
  LocalizerConfig config() const;                                 // points into this
  double plane_msl_m() const;                                     // from which the surface's heights count
  std::optional<double> ground_msl_m(const LonLat& place) const;  // nothing where the ground is taken for flat

  ApiPackage for_api() const { return package_for_api(folder_, package_); }

 private:
  std::shared_ptr<const OpenPackage> package_;
  std::filesystem::path folder_;
  std::shared_ptr<const LocalFrame> frame_;
  std::shared_ptr<const TerrainSurface> surface_;  // null: flat
  std::optional<PlaceIndex> places_;
};

}  // namespace nadir
