#include "simulation/geotiff_writer.hpp"

#include <cpl_conv.h>
#include <cpl_string.h>
#include <gdal_priv.h>
#include <ogr_spatialref.h>

#include "base/error.hpp"
#include "raster/gdal_dataset.hpp"
#include "raster/gdal_drivers.hpp"

namespace nadir {
namespace {

[[noreturn]] void fail(const std::filesystem::path& path) {
  throw Error({.what = "the raster cannot be written",
               .where = path.string(),
               .found = CPLGetLastErrorMsg(),
               .fix = "check the free space and the permissions of the folder"});
}

GdalHandle create(const std::filesystem::path& path, cv::Size size, int bands, GDALDataType type,
                  const RasterPlacement& placement) {
  register_gdal_drivers();
  // The default grows with the machine's memory; every pixel is written only once.
  if (GDALGetCacheMax64() > (GIntBig{256} << 20)) GDALSetCacheMax64(GIntBig{256} << 20);
  CPLStringList options;
  options.SetNameValue("TILED", "YES");
  options.SetNameValue("BLOCKXSIZE", "256");
  options.SetNameValue("BLOCKYSIZE", "256");
  options.SetNameValue("COMPRESS", "DEFLATE");
  options.SetNameValue("ZLEVEL", "2");
  options.SetNameValue("PREDICTOR", type == GDT_Byte ? "2" : "3");
  options.SetNameValue("NUM_THREADS", "2");
  options.SetNameValue("BIGTIFF", "IF_SAFER");
  if (bands == 3) options.SetNameValue("PHOTOMETRIC", "RGB");
  GdalHandle dataset(GetGDALDriverManager()->GetDriverByName("GTiff")->Create(path.c_str(), size.width, size.height,
                                                                              bands, type, options.List()));
  if (!dataset) fail(path);
  double transform[6] = {placement.west_m, placement.gsd_m, 0, placement.north_m, 0, -placement.gsd_m};
  OGRSpatialReference crs;
  if (crs.importFromEPSG(placement.epsg) != OGRERR_NONE || dataset->SetGeoTransform(transform) != CE_None ||
      dataset->SetSpatialRef(&crs) != CE_None) {
    fail(path);
  }
  return dataset;
}

}  // namespace

struct GeoTiffWriter::Impl {
  std::filesystem::path path;
  GdalHandle dataset;
  cv::Size size;
  int next_row = 0;
};

GeoTiffWriter::GeoTiffWriter(const std::filesystem::path& path, cv::Size size, const RasterPlacement& placement)
    : impl_(std::make_unique<Impl>(Impl{path, create(path, size, 3, GDT_Byte, placement), size})) {}

GeoTiffWriter::~GeoTiffWriter() = default;

void GeoTiffWriter::write_rows(const cv::Mat_<cv::Vec3b>& bgr) {
  int bands[3] = {3, 2, 1};
  void* data = const_cast<unsigned char*>(bgr.data);  // GDAL's interface reads and writes alike
  const CPLErr code =
      impl_->dataset->RasterIO(GF_Write, 0, impl_->next_row, bgr.cols, bgr.rows, data, bgr.cols, bgr.rows, GDT_Byte, 3,
                               bands, 3, static_cast<GSpacing>(bgr.step), 1, nullptr);
  if (code != CE_None) fail(impl_->path);
  impl_->next_row += bgr.rows;
}

void GeoTiffWriter::finish() {
  CPLErrorReset();
  impl_->dataset.reset();
  if (CPLGetLastErrorType() >= CE_Failure) fail(impl_->path);
}

void write_heights(const std::filesystem::path& path, const cv::Mat_<float>& heights_m,
                   const RasterPlacement& placement) {
  GdalHandle dataset = create(path, heights_m.size(), 1, GDT_Float32, placement);
  void* data = const_cast<unsigned char*>(heights_m.data);
  if (dataset->GetRasterBand(1)->RasterIO(GF_Write, 0, 0, heights_m.cols, heights_m.rows, data, heights_m.cols,
                                          heights_m.rows, GDT_Float32, 4, static_cast<GSpacing>(heights_m.step),
                                          nullptr) != CE_None) {
    fail(path);
  }
  CPLErrorReset();
  dataset.reset();
  if (CPLGetLastErrorType() >= CE_Failure) fail(path);
}

}  // namespace nadir
