// East-north-up metres around an origin (usually the take-off point), on the ellipsoid of WGS84.
//
// Computations in the plane (corridors, windows, the filter) use east and north alone: a PlanePoint. Enu is for what
// has a height as well.
#pragma once

#include <memory>

#include "geodesy/lon_lat.hpp"
#include "geodesy/plane_point.hpp"

namespace nadir {

struct Enu {
  double east_m = 0;
  double north_m = 0;
  double up_m = 0;
};

struct Geodetic {
  LonLat place;
  double height_m = 0;  // in the same height system as the origin's
};

class LocalFrame {
 public:
  explicit LocalFrame(LonLat origin, double origin_height_m = 0);
  ~LocalFrame();
  LocalFrame(const LocalFrame&);
  LocalFrame& operator=(const LocalFrame&);

  LonLat origin() const { return origin_; }
  Enu enu_from_geodetic(const Geodetic& point) const;
  Geodetic geodetic_from_enu(const Enu& point) const;

  // Horizontal positions: of the point at the height of the origin, and of the point in the plane.
  PlanePoint plane_from_lonlat(LonLat place) const;
  LonLat lonlat_from_plane(PlanePoint point) const;

 private:
  struct Impl;
  LonLat origin_;
  double origin_height_m_;
  std::unique_ptr<Impl> impl_;
};

}  // namespace nadir
