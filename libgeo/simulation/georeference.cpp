#include "simulation/georeference.hpp"

#include <fmt/format.h>
#include <gdal_priv.h>
#include <ogr_spatialref.h>

#include <cmath>

#include "base/error.hpp"

namespace nadir {

Georeference::Georeference(GDALDataset& dataset, const std::filesystem::path& path) : path_(path) {
  const OGRSpatialReference* crs = dataset.GetSpatialRef();
  if (crs == nullptr || dataset.GetGeoTransform(forward_) != CE_None || !GDALInvGeoTransform(forward_, backward_)) {
    throw UsageError({.what = "the raster is not georeferenced",
                      .where = path.string(),
                      .expected = "a coordinate system and a geotransform",
                      .found = crs == nullptr ? "no coordinate system" : "no geotransform",
                      .fix = "use a GeoTIFF; gdal_translate -a_srs EPSG:… -a_ullr … adds what is missing"});
  }
  OGRSpatialReference wgs84;
  wgs84.SetFromUserInput("EPSG:4326");
  wgs84.SetAxisMappingStrategy(OAMS_TRADITIONAL_GIS_ORDER);
  OGRSpatialReference own(*crs);
  own.SetAxisMappingStrategy(OAMS_TRADITIONAL_GIS_ORDER);
  crs_from_lonlat_.reset(OGRCreateCoordinateTransformation(&wgs84, &own));
  lonlat_from_crs_.reset(OGRCreateCoordinateTransformation(&own, &wgs84));
  if (!crs_from_lonlat_ || !lonlat_from_crs_) {
    throw UsageError({.what = "PROJ cannot reach the raster's coordinate system",
                      .where = path.string(),
                      .fix = "reproject it: gdalwarp -t_srs EPSG:…"});
  }
}

Georeference::~Georeference() = default;
Georeference::Georeference(Georeference&&) noexcept = default;
Georeference& Georeference::operator=(Georeference&&) noexcept = default;

bool Georeference::pixels_from_lonlat(std::vector<double>& x, std::vector<double>& y) const {
  std::vector<int> ok(x.size(), 1);
  crs_from_lonlat_->Transform(static_cast<int>(x.size()), x.data(), y.data(), nullptr, ok.data());
  bool all = true;
  for (std::size_t i = 0; i < x.size(); ++i) {
    all = all && ok[i] != 0;
    const double cx = x[i], cy = y[i];
    x[i] = backward_[0] + cx * backward_[1] + cy * backward_[2];
    y[i] = backward_[3] + cx * backward_[4] + cy * backward_[5];
  }
  return all;
}

LonLat Georeference::lonlat_from_pixel(double column, double row) const {
  double x = forward_[0] + column * forward_[1] + row * forward_[2];
  double y = forward_[3] + column * forward_[4] + row * forward_[5];
  if (lonlat_from_crs_->Transform(1, &x, &y) == 0 || !std::isfinite(x) || !std::isfinite(y)) {
    throw UsageError({.what = "the raster lies nowhere on Earth",
                      .where = path_.string(),
                      .expected = "pixels that its coordinate system knows",
                      .found = fmt::format("none at column {}, row {}", column, row),
                      .fix = "check its georeference with gdalinfo"});
  }
  return {x, y};
}

}  // namespace nadir
