// The ground of a package's elevation model in the plane of the estimates.
//
// A position in the plane becomes one in the raster by interpolation in a coarse table (250 m: a millimetre off), then
// heights are bilinear between the raster's posts: two dozen multiplications a point. Beyond the raster, and in its
// holes, the nearest known height continues: a step down to nothing would look like a cliff.
#pragma once

#include <Eigen/Core>
#include <span>
#include <vector>

#include "geodesy/local_frame.hpp"
#include "imagery/terrain_raster.hpp"
#include "vision/ground_surface.hpp"
#include "vision/localizer_parameters.hpp"

namespace nadir {

class TerrainSurface final : public GroundSurface {
 public:
  // raster: must outlive this. plane_height_m: of the plane, in the raster's own heights.
  TerrainSurface(const TerrainRaster& raster, const LocalFrame& frame, double plane_height_m = 0,
                 double relief_sigma_m = parameters::terrain::kReliefSigma_m);
  TerrainSurface(const TerrainSurface&) = delete;
  TerrainSurface& operator=(const TerrainSurface&) = delete;

  double height_m(PlanePoint point) const override;
  double relief_sigma_m() const override { return relief_sigma_m_; }
  double msl_m(const LonLat& place) const;  // in the raster's own heights

 private:
  struct Post {
    double column = 0, row = 0;
  };
  Post post_at(PlanePoint point) const;
  double raster_height_m(Post post) const;

  LocalFrame frame_;
  TerrainGrid grid_;
  std::vector<float> filled_;         // only where the raster has holes
  std::span<const float> heights_m_;  // the raster's, or filled_
  double plane_height_m_;
  double relief_sigma_m_;
  PlaneBox box_;
  double cell_m_ = 0;
  int cell_columns_ = 0, cell_rows_ = 0;
  std::vector<Post> posts_;  // at the corners of the table's cells
};

// Rise over run to the east and the north, over baseline_m to each side. The remaining relief is the surface's
// relief_sigma_m().
Eigen::Vector2d ground_slope(const GroundSurface& surface, PlanePoint at, double baseline_m);

}  // namespace nadir
