// The ground of a package's elevation model in the plane of the estimates.
//
// A place of the plane becomes a place of the raster by interpolation in a coarse table (250 m: a millimetre off), then
// heights are bilinear between the raster's posts: two dozen multiplications a point. Beyond the raster, and where it
// does not know, the nearest known height continues: a step down to nothing would look like a cliff.
#pragma once

#include <span>
#include <vector>

#include "geodesy/local_frame.hpp"
#include "imagery/terrain_raster.hpp"
#include "vision/ground_surface.hpp"

namespace nadir {

// What elevation models leave out over a frame's footprint. The global ones state 2 m (90 %) between neighbouring
// posts, hence about a metre, one sigma; across 200 to 300 m that is a slope of 0.004.
inline constexpr double kTerrainReliefSigma_m = 1.0;

class TerrainSurface final : public GroundSurface {
 public:
  // raster: must outlive this. plane_height_m: of the plane, in the raster's own heights.
  TerrainSurface(const TerrainRaster& raster, const LocalFrame& frame, double plane_height_m = 0,
                 double relief_sigma_m = kTerrainReliefSigma_m);
  TerrainSurface(const TerrainSurface&) = delete;
  TerrainSurface& operator=(const TerrainSurface&) = delete;

  double height_m(PlanePoint point) const override;
  double relief_sigma_m() const override { return relief_sigma_m_; }

 private:
  struct Post {
    double column = 0, row = 0;
  };
  Post post_at(PlanePoint point) const;
  double raster_height_m(Post post) const;

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

}  // namespace nadir
