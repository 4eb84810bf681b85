#include "api/opened_package.hpp"

#include "estimation/terrain_surface.hpp"

namespace nadir {
namespace {

// The terrain with the package that it is a part of.
class PackageGround final : public GroundSurface {
 public:
  PackageGround(std::shared_ptr<const OpenPackage> package, const LocalFrame& frame)
      : package_(std::move(package)), surface_(*package_->terrain(), frame, package_->mission().terrain.height_m) {}

  double height_m(PlanePoint point) const override { return surface_.height_m(point); }
  double relief_sigma_m() const override { return surface_.relief_sigma_m(); }

 private:
  std::shared_ptr<const OpenPackage> package_;
  TerrainSurface surface_;
};

}  // namespace

PackageView package_view(const OpenPackage& package) {
  const Manifest& manifest = package.manifest();
  const ZoomRange zooms = package.imagery().zooms();
  return {.accepted = true,
          .reason = {},
          .mission = manifest.mission_id,
          .series = manifest.series,
          .sequence = manifest.sequence,
          .expires = manifest.expires,
          .min_zoom = zooms.min,
          .max_zoom = zooms.max,
          .tiles = package.imagery().sidecars().size(),
          .terrain = package.terrain() != nullptr,
          .bounds = manifest.bounds,
          .route = package.mission().route.points};
}

PackageView refused_package(const Findings& findings) {
  PackageView view;
  view.reason = "refused";
  for (const Finding& finding : findings.items()) {
    if (finding.severity != Severity::error) continue;
    view.reason = finding.code + ": " + finding.where;
    break;
  }
  return view;
}

ApiPackage package_for_api(std::shared_ptr<const OpenPackage> package) {
  ApiPackage result;
  result.tiles = package->another_imagery_reader();
  result.frame = std::make_shared<const LocalFrame>(mission_frame(package->mission()));
  result.vectors = [package] { return package->read_vectors(); };
  if (package->terrain() != nullptr) result.surface = std::make_shared<const PackageGround>(package, *result.frame);
  return result;
}

}  // namespace nadir
