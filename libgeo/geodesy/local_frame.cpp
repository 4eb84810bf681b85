#include "geodesy/local_frame.hpp"

#include <cmath>

#include "geodesy/angles.hpp"
#include "geodesy/hypotenuse.hpp"

namespace nadir {
namespace {

// WGS84.
constexpr double kSemiMajor_m = 6378137.0, kFlattening = 1 / 298.257223563;
constexpr double kSemiMinor_m = kSemiMajor_m * (1 - kFlattening);
constexpr double kEccentricity2 = kFlattening * (2 - kFlattening);
constexpr double kSecondEccentricity2 = kEccentricity2 / (1 - kEccentricity2);

struct Angle {
  explicit Angle(double angle_rad) : sin(std::sin(angle_rad)), cos(std::cos(angle_rad)) {}
  double sin, cos;
};

// Earth-centred, earth-fixed: x through 0° N 0° E, z through the north pole.
struct Ecef {
  double x_m, y_m, z_m;
};

// N, the radius of curvature in the prime vertical, is a / √(1 - e² sin² φ).
double flattening_root(double sin_lat) { return std::sqrt(1 - kEccentricity2 * sin_lat * sin_lat); }

Ecef ecef_from_geodetic(const Angle& lat, const Angle& lon, double height_m) {
  const double curvature_m = kSemiMajor_m / flattening_root(lat.sin);
  const double from_axis_m = (curvature_m + height_m) * lat.cos;
  return {from_axis_m * lon.cos, from_axis_m * lon.sin, (curvature_m * (1 - kEccentricity2) + height_m) * lat.sin};
}

// B. R. Bowring, Transformation from spatial to geographical coordinates, Survey Review 23 (1976): the latitude from
// the parametric one, β, repeated. Not by a library: GeographicLib's machine code rounds differently on amd64 and
// arm64.
Geodetic geodetic_from_ecef(const Ecef& point) {
  const double from_axis_m = hypotenuse(point.x_m, point.y_m);
  double parametric_rad = std::atan2(point.z_m, (1 - kFlattening) * from_axis_m), lat_rad = 0;
  for (int i = 0; i < 3; ++i) {
    const Angle beta(parametric_rad);
    lat_rad = std::atan2(point.z_m + kSecondEccentricity2 * kSemiMinor_m * beta.sin * beta.sin * beta.sin,
                         from_axis_m - kEccentricity2 * kSemiMajor_m * beta.cos * beta.cos * beta.cos);
    parametric_rad = std::atan2((1 - kFlattening) * std::sin(lat_rad), std::cos(lat_rad));
  }
  const Angle lat(lat_rad);
  const double height_m = from_axis_m * lat.cos + point.z_m * lat.sin - kSemiMajor_m * flattening_root(lat.sin);
  return {{degrees(std::atan2(point.y_m, point.x_m)), degrees(lat_rad)}, height_m};
}

}  // namespace

struct LocalFrame::Impl {
  Impl(LonLat origin, double height_m)
      : lat(radians(origin.lat_deg)), lon(radians(origin.lon_deg)), centre(ecef_from_geodetic(lat, lon, height_m)) {}

  Angle lat, lon;
  Ecef centre;
};

LocalFrame::LocalFrame(LonLat origin, double origin_height_m)
    : origin_(origin), origin_height_m_(origin_height_m), impl_(std::make_unique<Impl>(origin, origin_height_m)) {}

LocalFrame::~LocalFrame() = default;
LocalFrame::LocalFrame(const LocalFrame& other)
    : origin_(other.origin_), origin_height_m_(other.origin_height_m_), impl_(std::make_unique<Impl>(*other.impl_)) {}
LocalFrame& LocalFrame::operator=(const LocalFrame& other) {
  origin_ = other.origin_;
  origin_height_m_ = other.origin_height_m_;
  *impl_ = *other.impl_;
  return *this;
}

Enu LocalFrame::enu_from_geodetic(const Geodetic& point) const {
  const Ecef at =
      ecef_from_geodetic(Angle(radians(point.place.lat_deg)), Angle(radians(point.place.lon_deg)), point.height_m);
  const double dx = at.x_m - impl_->centre.x_m, dy = at.y_m - impl_->centre.y_m, dz = at.z_m - impl_->centre.z_m;
  const Angle &lat = impl_->lat, &lon = impl_->lon;
  const double outward = lon.cos * dx + lon.sin * dy;
  return {-lon.sin * dx + lon.cos * dy, -lat.sin * outward + lat.cos * dz, lat.cos * outward + lat.sin * dz};
}

Geodetic LocalFrame::geodetic_from_enu(const Enu& point) const {
  const Angle &lat = impl_->lat, &lon = impl_->lon;
  const double outward = -lat.sin * point.north_m + lat.cos * point.up_m;
  return geodetic_from_ecef({impl_->centre.x_m + (-lon.sin * point.east_m + lon.cos * outward),
                             impl_->centre.y_m + (lon.cos * point.east_m + lon.sin * outward),
                             impl_->centre.z_m + (lat.cos * point.north_m + lat.sin * point.up_m)});
}

PlanePoint LocalFrame::plane_from_lonlat(LonLat place) const {
  const Enu enu = enu_from_geodetic({place, origin_height_m_});
  return {enu.east_m, enu.north_m};
}

LonLat LocalFrame::lonlat_from_plane(PlanePoint point) const {
  return geodetic_from_enu({point.east_m, point.north_m, 0}).place;
}

}  // namespace nadir
