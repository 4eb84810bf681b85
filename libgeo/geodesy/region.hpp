// The area that a mission covers: sectors (polygons) and the corridor along the route, in local metres, and the plane
// geometry for it. A Region answers containment for single points; coverage rasterises with it.
#pragma once

#include <vector>

#include "geodesy/local_frame.hpp"
#include "geodesy/lon_lat.hpp"
#include "geodesy/plane_point.hpp"

namespace nadir {

using PlaneRing = std::vector<PlanePoint>;  // closed implicitly: the last point joins the first
using PlanePath = std::vector<PlanePoint>;

// Signed area: positive when counter-clockwise.
double area_m2(const PlaneRing& ring);
bool self_intersects(const PlaneRing& ring);
bool contains(const PlaneRing& ring, PlanePoint point);  // even-odd rule
double distance_to_path_m(const PlanePath& path, PlanePoint point);
double length_m(const PlanePath& path);

PlaneRing to_plane(const LocalFrame& frame, const std::vector<LonLat>& points);

struct PlaneBox {
  double west_m = 0, south_m = 0, east_m = 0, north_m = 0;

  PlanePoint middle() const { return {(west_m + east_m) / 2, (south_m + north_m) / 2}; }
  double area_m2() const { return (east_m - west_m) * (north_m - south_m); }
};

inline PlaneBox square_around(PlanePoint middle, double half_side_m) {
  return {middle.east_m - half_side_m, middle.north_m - half_side_m, middle.east_m + half_side_m,
          middle.north_m + half_side_m};
}

struct Corridor {
  PlanePath path;
  double half_width_m = 0;  // round caps and joints: every point within this distance of the path
};

struct Region {
  std::vector<PlaneRing> rings;
  std::vector<Corridor> corridors;

  bool contains(PlanePoint point) const;
  PlaneBox bounds() const;
};

}  // namespace nadir
