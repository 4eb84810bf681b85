#include <ogrsf_frmts.h>

#include <charconv>

#include "base/error.hpp"
#include "base/printable.hpp"
#include "catalogue/catalogue_database.hpp"

namespace nadir {

CatalogueRow::CatalogueRow(std::unique_ptr<OGRFeature> feature) : feature_(std::move(feature)) {}
CatalogueRow::~CatalogueRow() = default;
CatalogueRow::CatalogueRow(CatalogueRow&&) noexcept = default;

int CatalogueRow::index(const char* column) const {
  const int found = feature_->GetFieldIndex(column);
  if (found < 0) {
    throw Error({.what = "a column of the catalogue is missing",
                 .where = std::string(feature_->GetDefnRef()->GetName()),
                 .expected = column,
                 .fix = "somebody has changed the tables; make a new catalogue"});
  }
  return found;
}

CatalogueRow& CatalogueRow::set(const char* column, std::int64_t value) {
  feature_->SetField(index(column), static_cast<GIntBig>(value));
  return *this;
}

CatalogueRow& CatalogueRow::set(const char* column, double value) {
  feature_->SetField(index(column), value);
  return *this;
}

CatalogueRow& CatalogueRow::set(const char* column, std::string_view text) {
  feature_->SetField(index(column), printable(text).c_str());
  return *this;
}

CatalogueRow& CatalogueRow::set(const char* column, UtcTime time) {
  // "2024-10-30T00:00:00Z", the parts by their places
  const std::string text = to_rfc3339(time);
  const auto part = [&text](std::size_t at, std::size_t length) {
    int value = 0;
    std::from_chars(text.data() + at, text.data() + at + length, value);
    return value;
  };
  constexpr int kUtc = 100;  // OGR's time zone flag
  feature_->SetField(index(column), part(0, 4), part(5, 2), part(8, 2), part(11, 2), part(14, 2),
                     static_cast<float>(part(17, 2)), kUtc);
  return *this;
}

CatalogueRow& CatalogueRow::set_null(const char* column) {
  feature_->SetFieldNull(index(column));
  return *this;
}

CatalogueRow& CatalogueRow::shape(GeometryHandle geometry) {
  if (const OGRSpatialReference* reference = feature_->GetDefnRef()->GetGeomFieldCount() > 0
                                                 ? feature_->GetDefnRef()->GetGeomFieldDefn(0)->GetSpatialRef()
                                                 : nullptr;
      reference != nullptr) {
    geometry->assignSpatialReference(const_cast<OGRSpatialReference*>(reference));
  }
  feature_->SetGeometryDirectly(geometry.release());
  return *this;
}

std::int64_t CatalogueRow::integer(const char* column) const { return feature_->GetFieldAsInteger64(index(column)); }

bool CatalogueRow::is_null(const char* column) const { return !feature_->IsFieldSetAndNotNull(index(column)); }

std::string CatalogueRow::text(const char* column) const { return feature_->GetFieldAsString(index(column)); }

std::optional<UtcTime> CatalogueRow::time(const char* column) const {
  int year = 0, month = 0, day = 0, hour = 0, minute = 0, zone = 0;
  float second = 0;
  const int field = index(column);
  if (!feature_->IsFieldSetAndNotNull(field) ||
      feature_->GetFieldAsDateTime(field, &year, &month, &day, &hour, &minute, &second, &zone) == FALSE) {
    return std::nullopt;
  }
  const auto local =
      parse_utc(CPLSPrintf("%04d-%02d-%02dT%02d:%02d:%02dZ", year, month, day, hour, minute, static_cast<int>(second)));
  // Servers answer in their session's time zone: OGR counts quarters of an hour from 100, which is UTC.
  constexpr int kUtc = 100, kQuarter_s = 900;
  if (local && zone > 1) return UtcTime{local->unix_s - std::int64_t{zone - kUtc} * kQuarter_s};
  return local;
}

GeoArea CatalogueRow::area() const {
  const OGRGeometry* geometry = feature_->GetGeometryRef();
  return geometry == nullptr ? GeoArea() : area_from(*geometry);
}

}  // namespace nadir
