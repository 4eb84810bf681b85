// A horizontal position in the local plane: metres east and north of the origin of a LocalFrame.
//
// The plane touches the ellipsoid at the origin; its axes point to true east and true north there. A point of the Earth
// lies where its foot in the plane is, at the east and north of its East-North-Up coordinates: plane_from_lonlat() for
// the ground at the origin's height, and lonlat_from_plane() back. 10 km from the origin the plane is 8 m above the
// ellipsoid, the distance from the origin 4 mm too short, north off by the convergence of the meridians (0.1° at
// 48° N), and there and back again is 12 mm off, because lonlat_from_plane() means the point in the plane.
//
// Positions and displacements are different things, as points and vectors of an affine plane are: a position is a
// PlanePoint, a displacement (offset, residual, correction, velocity) an Eigen::Vector2d of east and north.
//
//   b - a     displacement from a to b
//   a + d     position a, displaced by d
//
// The sum of two positions has no meaning and does not compile. vector() is the displacement from the origin, for
// linear algebra. Two positions can be compared only when their frames have the same origin; nothing checks that.
#pragma once

#include <Eigen/Core>

#include "geodesy/hypotenuse.hpp"

namespace nadir {

struct PlanePoint {
  double east_m = 0;
  double north_m = 0;

  constexpr PlanePoint() = default;
  constexpr PlanePoint(double east, double north) : east_m(east), north_m(north) {}
  explicit PlanePoint(const Eigen::Vector2d& from_origin_m) : east_m(from_origin_m.x()), north_m(from_origin_m.y()) {}

  Eigen::Vector2d vector() const { return {east_m, north_m}; }

  friend Eigen::Vector2d operator-(PlanePoint to, PlanePoint from) {
    return {to.east_m - from.east_m, to.north_m - from.north_m};
  }
  friend PlanePoint operator+(PlanePoint from, const Eigen::Vector2d& displacement_m) {
    return {from.east_m + displacement_m.x(), from.north_m + displacement_m.y()};
  }
  friend PlanePoint operator-(PlanePoint from, const Eigen::Vector2d& displacement_m) {
    return {from.east_m - displacement_m.x(), from.north_m - displacement_m.y()};
  }
  bool operator==(const PlanePoint&) const = default;
};

inline double distance_m(PlanePoint a, PlanePoint b) { return hypotenuse(a.east_m - b.east_m, a.north_m - b.north_m); }

}  // namespace nadir
