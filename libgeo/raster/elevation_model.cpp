#include "raster/elevation_model.hpp"

#include <cpl_string.h>
#include <gdal_alg.h>
#include <gdal_priv.h>

#include <array>
#include <cmath>
#include <string_view>

#include "base/error.hpp"
#include "raster/gdal_dataset.hpp"

namespace nadir {

struct ElevationModel::Impl {
  GdalHandle dataset;
  GDALRasterBand* band = nullptr;
  std::unique_ptr<void, void (*)(void*)> transformer{nullptr, GDALDestroyGenImgProjTransformer};
  std::optional<double> nodata;
};

ElevationModel::ElevationModel(const std::filesystem::path& path) : impl_(std::make_unique<Impl>()) {
  const QuietGdal quiet;
  impl_->dataset = open_gdal_raster(path);
  const auto reject = [&path](const char* expected, std::string found) {
    throw UsageError({.what = "this is no elevation model",
                      .where = path.string(),
                      .expected = expected,
                      .found = std::move(found)});
  };
  if (impl_->dataset->GetRasterCount() < 1) reject("one band of heights", "none");
  impl_->band = impl_->dataset->GetRasterBand(1);
  if (GDALDataTypeIsComplex(impl_->band->GetRasterDataType()) != 0) reject("heights", "complex numbers");
  const std::string_view unit = impl_->band->GetUnitType();
  if (!unit.empty() && unit != "m" && unit != "metre" && unit != "meter" && unit != "metres" && unit != "meters") {
    reject("heights in metres", "the unit \"" + std::string(unit) + "\"");
  }
  int has_nodata = 0;
  const double nodata = impl_->band->GetNoDataValue(&has_nodata);
  if (has_nodata != 0) impl_->nodata = nodata;
  const std::unique_ptr<char*, void (*)(char**)> options(CSLSetNameValue(nullptr, "DST_SRS", "EPSG:4326"), CSLDestroy);
  if (impl_->dataset->GetSpatialRef() != nullptr) {
    impl_->transformer.reset(
        GDALCreateGenImgProjTransformer2(GDALDataset::ToHandle(impl_->dataset.get()), nullptr, options.get()));
  }
  if (!impl_->transformer) reject("a georeferenced raster", "no coordinate system or no geotransform");
}

ElevationModel::~ElevationModel() = default;

std::optional<double> ElevationModel::height_m(LonLat place) const {
  const QuietGdal quiet;
  double x = place.lon_deg, y = place.lat_deg, z = 0;
  int done = 0;
  GDALGenImgProjTransform(impl_->transformer.get(), 1, 1, &x, &y, &z, &done);
  const int columns = impl_->dataset->GetRasterXSize(), rows = impl_->dataset->GetRasterYSize();
  if (done == 0 || !(x >= 0 && y >= 0 && x <= columns && y <= rows)) return std::nullopt;
  // Heights are those of pixels' centres; in the half pixel at the edge the nearest one counts.
  const double u = std::clamp(x - 0.5, 0.0, columns - 1.0), v = std::clamp(y - 0.5, 0.0, rows - 1.0);
  const int left = std::min(static_cast<int>(u), std::max(0, columns - 2));
  const int top = std::min(static_cast<int>(v), std::max(0, rows - 2));
  const int wide = std::min(2, columns), high = std::min(2, rows);
  std::array<double, 4> posts{};
  if (impl_->band->RasterIO(GF_Read, left, top, wide, high, posts.data(), wide, high, GDT_Float64, 0, 0, nullptr) !=
      CE_None) {
    return std::nullopt;
  }
  const auto post = [&](int column, int row) {
    return posts[static_cast<std::size_t>(std::min(row, high - 1) * wide + std::min(column, wide - 1))];
  };
  for (int row = 0; row < 2; ++row) {
    for (int column = 0; column < 2; ++column) {
      const double value = post(column, row);
      if (!std::isfinite(value) || (impl_->nodata && value == *impl_->nodata)) return std::nullopt;
    }
  }
  const double s = u - left, t = v - top;
  return (1 - t) * ((1 - s) * post(0, 0) + s * post(1, 0)) + t * ((1 - s) * post(0, 1) + s * post(1, 1));
}

}  // namespace nadir
