#include "package_build/matchability_tiff.hpp"

#include <cpl_vsi.h>
#include <fmt/format.h>
#include <gdal_priv.h>
#include <ogr_spatialref.h>

#include <array>
#include <vector>

#include "base/error.hpp"
#include "base/files.hpp"
#include "raster/gdal_dataset.hpp"

namespace nadir {
namespace {

struct BandText {
  const char* name;
  double (*value)(const PlaceMatchability&);
};
constexpr std::array<BandText, 6> kBands{{
    {"ratio", [](const PlaceMatchability& place) { return place.ratio; }},
    {"entropy", [](const PlaceMatchability& place) { return place.entropy; }},
    {"texture", [](const PlaceMatchability& place) { return place.texture; }},
    {"class", [](const PlaceMatchability& place) { return static_cast<double>(place.cls); }},
    {"score", [](const PlaceMatchability& place) { return place.score; }},
    {"valid", [](const PlaceMatchability& place) { return place.valid; }},
}};

std::vector<float> values_of(const MatchabilityMap& map, const BandText& band) {
  std::vector<float> values;
  values.reserve(map.cells.size());
  for (const PlaceMatchability& cell : map.cells) {
    values.push_back(cell.cls == MatchClass::outside ? kMatchabilityNodata : static_cast<float>(band.value(cell)));
  }
  return values;
}

// A file in memory, so that the real one is written in one step.
class MemoryFile {
 public:
  MemoryFile() : name_(fmt::format("/vsimem/matchability-{}.tif", static_cast<const void*>(this))) {}
  ~MemoryFile() { VSIUnlink(name_.c_str()); }
  MemoryFile(const MemoryFile&) = delete;
  MemoryFile& operator=(const MemoryFile&) = delete;

  const std::string& name() const { return name_; }
  ByteView bytes() const {
    vsi_l_offset size = 0;
    const GByte* data = VSIGetMemFileBuffer(name_.c_str(), &size, FALSE);
    return {data, static_cast<std::size_t>(size)};
  }

 private:
  std::string name_;
};

}  // namespace

void write_matchability_tiff(const MatchabilityMap& map, const std::filesystem::path& path) {
  GDALAllRegister();
  const QuietGdal quiet;
  const auto need = [&](bool ok) {
    if (!ok) {
      throw Error(
          {.what = "the matchability map cannot be written", .where = path.string(), .found = QuietGdal::last_error()});
    }
  };
  const MatchabilityGrid& grid = map.grid;
  GDALDriver* memory = GetGDALDriverManager()->GetDriverByName("MEM");
  GDALDriver* tiff = GetGDALDriverManager()->GetDriverByName("GTiff");
  need(memory != nullptr && tiff != nullptr);
  const GdalHandle picture(
      memory->Create("", grid.columns, grid.rows, static_cast<int>(kBands.size()), GDT_Float32, nullptr));
  need(picture != nullptr);
  const MercatorXY corner = mercator_from_lonlat(grid.place(0, 0));
  const double side = grid.step_px * mercator_pixel_m(grid.zoom);
  std::array<double, 6> transform{corner.x_m, side, 0, corner.y_m, 0, -side};
  OGRSpatialReference system;
  need(system.importFromEPSG(3857) == OGRERR_NONE && picture->SetGeoTransform(transform.data()) == CE_None &&
       picture->SetSpatialRef(&system) == CE_None);
  for (std::size_t i = 0; i < kBands.size(); ++i) {
    GDALRasterBand* band = picture->GetRasterBand(static_cast<int>(i) + 1);
    std::vector<float> values = values_of(map, kBands[i]);
    band->SetDescription(kBands[i].name);
    need(band->SetNoDataValue(static_cast<double>(kMatchabilityNodata)) == CE_None &&
         band->RasterIO(GF_Write, 0, 0, grid.columns, grid.rows, values.data(), grid.columns, grid.rows, GDT_Float32, 0,
                        0, nullptr) == CE_None);
  }
  picture->SetMetadataItem("CLASSES", "1 good, 2 weak, 3 poor");
  std::array<const char*, 7> options{"COMPRESS=DEFLATE", "PREDICTOR=3",         "ZLEVEL=6", "INTERLEAVE=BAND",
                                     "NUM_THREADS=1",    "GEOTIFF_VERSION=1.1", nullptr};
  const MemoryFile file;
  GdalHandle written(
      tiff->CreateCopy(file.name().c_str(), picture.get(), 0, const_cast<char**>(options.data()), nullptr, nullptr));
  need(written != nullptr);
  CPLErrorReset();
  written.reset();
  need(CPLGetLastErrorType() < CE_Failure);
  write_file_atomic(path, file.bytes());
}

}  // namespace nadir
