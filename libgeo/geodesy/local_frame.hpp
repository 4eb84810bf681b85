// East-north-up metres around an origin (usually the take-off point): GeographicLib's LocalCartesian.
//
// Computations in the plane (corridors, windows, the filter) use east and north alone; at 10 km from the origin the plane's
// height error is 8 m and its horizontal error millimetres.
#pragma once

#include <memory>

#include "geodesy/lon_lat.hpp"

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

  // The same for positions on the ground: at the height of the origin.
  Enu enu_from_lonlat(LonLat place) const;
  LonLat lonlat_from_enu(double east_m, double north_m) const;

 private:
  struct Impl;
  LonLat origin_;
  double origin_height_m_;
  std::unique_ptr<Impl> impl_;
};

}  // namespace nadir
