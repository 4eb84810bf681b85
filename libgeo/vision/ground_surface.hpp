// The ground that the camera sees: a plane unless a terrain model says otherwise.
#pragma once

#include "geodesy/region.hpp"

namespace nadir {

class GroundSurface {
 public:
  virtual ~GroundSurface() = default;

  // Height above the map's plane.
  virtual double height_m(PlanePoint point) const = 0;

  // One sigma of the heights that height_m() does not know about, over a frame's footprint. Across a footprint they add
  // up to a slope, and a slope looks like a tilt of the camera: what is not known of it limits what a picture can say
  // about tilt.
  virtual double relief_sigma_m() const = 0;
};

class FlatGround final : public GroundSurface {
 public:
  // The default is what people call flat: ditches, embankments, a gentle rise.
  explicit FlatGround(double relief_sigma_m = 1.5) : relief_sigma_m_(relief_sigma_m) {}

  double height_m(PlanePoint) const override { return 0; }
  double relief_sigma_m() const override { return relief_sigma_m_; }

 private:
  double relief_sigma_m_;
};

}  // namespace nadir
