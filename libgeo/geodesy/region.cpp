#include "geodesy/region.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "geodesy/hypotenuse.hpp"

namespace nadir {
namespace {

double cross(PlanePoint origin, PlanePoint a, PlanePoint b) {
  return (a.east_m - origin.east_m) * (b.north_m - origin.north_m) -
         (a.north_m - origin.north_m) * (b.east_m - origin.east_m);
}

bool properly_cross(PlanePoint a, PlanePoint b, PlanePoint c, PlanePoint d) {
  const double abc = cross(a, b, c), abd = cross(a, b, d), cda = cross(c, d, a), cdb = cross(c, d, b);
  return ((abc > 0) != (abd > 0)) && ((cda > 0) != (cdb > 0)) && abc != 0 && abd != 0 && cda != 0 && cdb != 0;
}

double distance_to_segment_m(PlanePoint a, PlanePoint b, PlanePoint p) {
  const double dx = b.east_m - a.east_m, dy = b.north_m - a.north_m;
  const double squared = dx * dx + dy * dy;
  const double along =
      squared > 0 ? std::clamp(((p.east_m - a.east_m) * dx + (p.north_m - a.north_m) * dy) / squared, 0.0, 1.0) : 0.0;
  return hypotenuse(p.east_m - a.east_m - along * dx, p.north_m - a.north_m - along * dy);
}

}  // namespace

double area_m2(const PlaneRing& ring) {
  double twice = 0;
  for (std::size_t i = 0; i < ring.size(); ++i) {
    const PlanePoint a = ring[i], b = ring[(i + 1) % ring.size()];
    twice += a.east_m * b.north_m - b.east_m * a.north_m;
  }
  return twice / 2;
}

bool self_intersects(const PlaneRing& ring) {
  const std::size_t n = ring.size();
  for (std::size_t i = 0; i < n; ++i) {
    for (std::size_t j = i + 1; j < n; ++j) {
      if (properly_cross(ring[i], ring[(i + 1) % n], ring[j], ring[(j + 1) % n])) return true;
    }
  }
  return false;
}

bool contains(const PlaneRing& ring, PlanePoint point) {
  bool inside = false;
  for (std::size_t i = 0, j = ring.size() - 1; i < ring.size(); j = i++) {
    const PlanePoint a = ring[i], b = ring[j];
    if ((a.north_m > point.north_m) == (b.north_m > point.north_m)) continue;
    const double t = (point.north_m - a.north_m) / (b.north_m - a.north_m);
    if (point.east_m < a.east_m + t * (b.east_m - a.east_m)) inside = !inside;
  }
  return inside;
}

double distance_to_path_m(const PlanePath& path, PlanePoint point) {
  if (path.size() == 1) return distance_m(point, path[0]);
  double nearest = std::numeric_limits<double>::infinity();
  for (std::size_t i = 0; i + 1 < path.size(); ++i) {
    nearest = std::min(nearest, distance_to_segment_m(path[i], path[i + 1], point));
  }
  return nearest;
}

double length_m(const PlanePath& path) {
  double sum = 0;
  for (std::size_t i = 0; i + 1 < path.size(); ++i) {
    sum += distance_m(path[i + 1], path[i]);
  }
  return sum;
}

PlaneRing to_plane(const LocalFrame& frame, const std::vector<LonLat>& points) {
  PlaneRing ring;
  ring.reserve(points.size());
  for (const LonLat place : points) ring.push_back(frame.plane_from_lonlat(place));
  return ring;
}

bool Region::contains(PlanePoint point) const {
  return std::any_of(rings.begin(), rings.end(), [&](const PlaneRing& ring) { return nadir::contains(ring, point); }) ||
         std::any_of(corridors.begin(), corridors.end(), [&](const Corridor& corridor) {
           return distance_to_path_m(corridor.path, point) <= corridor.half_width_m;
         });
}

PlaneBox Region::bounds() const {
  constexpr double infinity = std::numeric_limits<double>::infinity();
  PlaneBox box{infinity, infinity, -infinity, -infinity};
  const auto include = [&box](PlanePoint point, double margin_m) {
    box.west_m = std::min(box.west_m, point.east_m - margin_m);
    box.south_m = std::min(box.south_m, point.north_m - margin_m);
    box.east_m = std::max(box.east_m, point.east_m + margin_m);
    box.north_m = std::max(box.north_m, point.north_m + margin_m);
  };
  for (const PlaneRing& ring : rings) {
    for (const PlanePoint point : ring) include(point, 0);
  }
  for (const Corridor& corridor : corridors) {
    for (const PlanePoint point : corridor.path) include(point, corridor.half_width_m);
  }
  return box;
}

}  // namespace nadir
