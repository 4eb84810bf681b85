#include "package_build/vector_features.hpp"

#include <gdal_priv.h>
#include <ogrsf_frmts.h>

#include <memory>

#include "base/error.hpp"
#include "raster/gdal_dataset.hpp"
#include "raster/gdal_drivers.hpp"

namespace nadir {
namespace {

std::string name_of(const OGRFeature& feature) {
  for (const char* field : {"name", "Name", "NAME", "title", "id"}) {
    const int index = feature.GetFieldIndex(field);
    if (index >= 0 && feature.IsFieldSetAndNotNull(index)) return feature.GetFieldAsString(index);
  }
  return {};
}

std::vector<LonLat> points_of(const OGRLineString& line) {
  std::vector<LonLat> points;
  for (int i = 0; i < line.getNumPoints(); ++i) points.push_back({line.getX(i), line.getY(i)});
  return points;
}

void append_geometry(const OGRGeometry& geometry, const std::string& name, const std::string& where,
                     VectorFeatures& features) {
  switch (wkbFlatten(geometry.getGeometryType())) {
    case wkbLineString: features.lines.push_back({name, points_of(*geometry.toLineString())}); break;
    case wkbPolygon: {
      const OGRPolygon& polygon = *geometry.toPolygon();
      if (polygon.getNumInteriorRings() > 0) {
        throw UsageError({.what = "an area has holes",
                          .where = where + (name.empty() ? "" : ": " + name),
                          .expected = "areas with one outline",
                          .found = std::to_string(polygon.getNumInteriorRings()) + " inner rings",
                          .fix = "remove the inner rings, or split the area so that it has none"});
      }
      if (const OGRLinearRing* ring = polygon.getExteriorRing(); ring != nullptr) {
        features.areas.push_back({name, points_of(*ring)});
      }
      break;
    }
    case wkbMultiLineString:
    case wkbMultiPolygon:
    case wkbGeometryCollection:
      for (const OGRGeometry* part : *geometry.toGeometryCollection()) append_geometry(*part, name, where, features);
      break;
    default: break;
  }
}

void append_layer(OGRLayer& layer, const std::string& where, VectorFeatures& features) {
  const OGRSpatialReference* reference = layer.GetSpatialRef();
  OGRSpatialReference wgs84;
  wgs84.importFromEPSG(4326);
  wgs84.SetAxisMappingStrategy(OAMS_TRADITIONAL_GIS_ORDER);
  std::unique_ptr<OGRCoordinateTransformation> transform;
  if (reference != nullptr) transform.reset(OGRCreateCoordinateTransformation(reference, &wgs84));
  for (const auto& feature : layer) {
    std::unique_ptr<OGRGeometry> geometry(
        feature->GetGeometryRef() == nullptr ? nullptr : feature->GetGeometryRef()->getLinearGeometry());
    if (!geometry) continue;
    if (!transform) {
      throw Error({.what = "the file is not georeferenced",
                   .where = where,
                   .expected = "a coordinate reference system",
                   .fix = "set one: ogr2ogr -a_srs EPSG:… OUT.geojson IN"});
    }
    geometry->flattenTo2D();
    if (geometry->transform(transform.get()) != OGRERR_NONE) {
      throw Error({.what = "a geometry cannot be transformed to WGS 84",
                   .where = where + ": feature " + std::to_string(feature->GetFID()),
                   .found = QuietGdal::last_error()});
    }
    append_geometry(*geometry, name_of(*feature), where, features);
  }
}

}  // namespace

VectorFeatures read_vector_features(const std::filesystem::path& path) {
  const QuietGdal quiet;
  register_gdal_drivers();
  if (!std::filesystem::is_regular_file(path)) {
    throw UsageError({.what = "no such file", .where = path.string(), .fix = "check the path"});
  }
  const GdalHandle dataset(GDALDataset::Open(path.c_str(), GDAL_OF_VECTOR | GDAL_OF_READONLY | GDAL_OF_VERBOSE_ERROR));
  if (!dataset) {
    throw Error({.what = "the file cannot be read",
                 .where = path.string(),
                 .expected = "a vector file: " + readable_vector_formats(),
                 .found = QuietGdal::last_error(),
                 .fix = "check the file with `ogrinfo`"});
  }
  VectorFeatures features;
  for (OGRLayer* layer : dataset->GetLayers()) append_layer(*layer, path.string(), features);
  return features;
}

}  // namespace nadir
