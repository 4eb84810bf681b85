#include "raster/value_raster.hpp"

#include <memory>
#include <stdexcept>

#include "geodesy/angles.hpp"
#include "geodesy/web_mercator.hpp"

namespace nadir::test {
namespace {

void need_written(bool ok) {
  if (!ok) throw std::runtime_error(CPLGetLastErrorMsg());
}

void write_band(GDALRasterBand& band, const ValueRaster& raster, const std::function<double(int, int)>& value) {
  std::vector<double> line(static_cast<std::size_t>(raster.size.width));
  for (int row = 0; row < raster.size.height; ++row) {
    const int stored = raster.south_up ? raster.size.height - 1 - row : row;
    for (int column = 0; column < raster.size.width; ++column) {
      line[static_cast<std::size_t>(column)] = value(column, row);
    }
    need_written(band.RasterIO(GF_Write, 0, stored, raster.size.width, 1, line.data(), raster.size.width, 1,
                               GDT_Float64, 0, 0, nullptr) == CE_None);
  }
}

}  // namespace

void write_values(const std::filesystem::path& path, const ValueRaster& raster) {
  GDALAllRegister();
  CPLSetConfigOption("GDAL_TIFF_INTERNAL_MASK", "YES");
  char** options = nullptr;
  for (const std::string& option : raster.options) options = CSLAddString(options, option.c_str());
  const std::unique_ptr<GDALDataset, void (*)(GDALDataset*)> dataset(
      GetGDALDriverManager()->GetDriverByName("GTiff")->Create(path.c_str(), raster.size.width, raster.size.height,
                                                               raster.bands, raster.type, options),
      [](GDALDataset* open) { GDALClose(open); });
  CSLDestroy(options);
  need_written(dataset != nullptr);
  const double pixel_m = mercator_pixel_m(kValueZoom), half_m = kPi * kMercatorRadius_m;
  double transform[6] = {kValuePixels.x * pixel_m - half_m, pixel_m, 0, half_m - kValuePixels.y * pixel_m, 0, -pixel_m};
  if (raster.south_up) transform[3] -= raster.size.height * pixel_m, transform[5] = pixel_m;
  need_written(dataset->SetGeoTransform(transform) == CE_None);
  OGRSpatialReference system;
  system.importFromEPSG(3857);
  need_written(dataset->SetSpatialRef(&system) == CE_None);
  if (!raster.palette.empty()) {
    GDALColorTable table;
    for (std::size_t i = 0; i < raster.palette.size(); ++i)
      table.SetColorEntry(static_cast<int>(i), &raster.palette[i]);
    need_written(dataset->GetRasterBand(1)->SetColorTable(&table) == CE_None);
  }
  for (int band = 1; band <= raster.bands; ++band) {
    const auto index = static_cast<std::size_t>(band - 1);
    if (index < raster.colours.size()) dataset->GetRasterBand(band)->SetColorInterpretation(raster.colours[index]);
    if (index < raster.nodata.size() && raster.nodata[index]) {
      need_written(dataset->GetRasterBand(band)->SetNoDataValue(*raster.nodata[index]) == CE_None);
    }
  }
  for (int band = 1; band <= raster.bands; ++band) {
    write_band(*dataset->GetRasterBand(band), raster,
               [&](int column, int row) { return raster.value(band, column, row); });
  }
  if (!raster.masked_out) return;
  need_written(dataset->CreateMaskBand(GMF_PER_DATASET) == CE_None);
  write_band(*dataset->GetRasterBand(1)->GetMaskBand(), raster,
             [&](int column, int row) { return raster.masked_out(column, row) ? 0.0 : 255.0; });
}

}  // namespace nadir::test
