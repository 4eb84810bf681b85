#include "geodesy/local_frame.hpp"

#include <GeographicLib/LocalCartesian.hpp>

namespace nadir {

struct LocalFrame::Impl {
  GeographicLib::LocalCartesian cartesian;
};

LocalFrame::LocalFrame(LonLat origin, double origin_height_m)
    : origin_(origin),
      origin_height_m_(origin_height_m),
      impl_(std::make_unique<Impl>(Impl{{origin.lat_deg, origin.lon_deg, origin_height_m}})) {}

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
  Enu enu;
  impl_->cartesian.Forward(point.place.lat_deg, point.place.lon_deg, point.height_m, enu.east_m, enu.north_m, enu.up_m);
  return enu;
}

Geodetic LocalFrame::geodetic_from_enu(const Enu& point) const {
  Geodetic result;
  impl_->cartesian.Reverse(point.east_m, point.north_m, point.up_m, result.place.lat_deg, result.place.lon_deg,
                           result.height_m);
  return result;
}

PlanePoint LocalFrame::plane_from_lonlat(LonLat place) const {
  const Enu enu = enu_from_geodetic({place, origin_height_m_});
  return {enu.east_m, enu.north_m};
}

LonLat LocalFrame::lonlat_from_plane(PlanePoint point) const {
  return geodetic_from_enu({point.east_m, point.north_m, 0}).place;
}

}  // namespace nadir
