// Between a raster's pixels and longitudes and latitudes, through GDAL's geotransform and PROJ.
#pragma once

#include <filesystem>
#include <memory>
#include <vector>

#include "geodesy/lon_lat.hpp"

class GDALDataset;
class OGRCoordinateTransformation;

namespace nadir {

class Georeference {
 public:
  // Throws UsageError when the raster has no coordinate system or geotransform, or PROJ does not know it.
  Georeference(GDALDataset& dataset, const std::filesystem::path& path);
  ~Georeference();
  Georeference(Georeference&&) noexcept;
  Georeference& operator=(Georeference&&) noexcept;

  // Longitudes and latitudes in, continuous pixels out. False when some cannot be reached; those are not finite.
  bool pixels_from_lonlat(std::vector<double>& x, std::vector<double>& y) const;
  // Throws UsageError for pixels that lie nowhere on Earth.
  LonLat lonlat_from_pixel(double column, double row) const;

 private:
  std::filesystem::path path_;
  std::unique_ptr<OGRCoordinateTransformation> crs_from_lonlat_, lonlat_from_crs_;
  double forward_[6] = {};   // crs from pixel
  double backward_[6] = {};  // pixel from crs
};

}  // namespace nadir
