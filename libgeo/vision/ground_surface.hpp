// The ground that the camera sees: a plane, or a terrain model.
#pragma once

#include "geodesy/region.hpp"
#include "vision/localizer_parameters.hpp"

namespace nadir {

class GroundSurface {
 public:
  virtual ~GroundSurface() = default;

  // Height above the map's plane.
  virtual double height_m(PlanePoint point) const = 0;

  // 1-sigma of the heights that height_m() does not model, over a frame's footprint. Across a footprint they add up to
  // a slope, and a slope looks like a tilt of the camera: this uncertainty limits how well an image determines the
  // tilt.
  virtual double relief_sigma_m() const = 0;
};

class FlatGround final : public GroundSurface {
 public:
  explicit FlatGround(double relief_sigma_m = kFlatGroundRelief_m) : relief_sigma_m_(relief_sigma_m) {}

  double height_m(PlanePoint) const override { return 0; }
  double relief_sigma_m() const override { return relief_sigma_m_; }

 private:
  double relief_sigma_m_;
};

}  // namespace nadir
