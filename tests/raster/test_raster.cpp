#include "raster/test_raster.hpp"

#include <fmt/format.h>
#include <gdal_priv.h>
#include <proj.h>

#include <algorithm>
#include <fstream>
#include <memory>
#include <stdexcept>
#include <vector>

namespace nadir::test {
namespace {

int bands_of(Kind kind) {
  switch (kind) {
    case Kind::grey:
    case Kind::palette:
    case Kind::uint16: return 1;
    case Kind::rgb: return 3;
    case Kind::rgba:
    case Kind::rgb_nir: return 4;
  }
  return 0;
}

void need(bool ok) {
  if (!ok) throw std::runtime_error(CPLGetLastErrorMsg());
}

}  // namespace

void write_raster(const std::filesystem::path& path, const RasterSpec& spec, const ColourAt& colour) {
  GDALAllRegister();
  CPLSetConfigOption("GDAL_TIFF_INTERNAL_MASK", "YES");
  const GDALDataType type = spec.kind == Kind::uint16 ? GDT_UInt16 : GDT_Byte;
  char** options = nullptr;
  if (spec.tiled) options = CSLSetNameValue(options, "TILED", "YES");
  if (spec.kind == Kind::rgba) options = CSLSetNameValue(options, "ALPHA", "YES");
  if (spec.kind == Kind::rgb_nir) options = CSLSetNameValue(options, "ALPHA", "NO");
  const int bands = bands_of(spec.kind);
  std::unique_ptr<GDALDataset, void (*)(GDALDataset*)> dataset(
      GetGDALDriverManager()->GetDriverByName("GTiff")->Create(path.c_str(), spec.width, spec.height, bands, type,
                                                               options),
      [](GDALDataset* open) { GDALClose(open); });
  CSLDestroy(options);
  need(dataset != nullptr);
  if (spec.transform) {
    auto transform = *spec.transform;
    need(dataset->SetGeoTransform(transform.data()) == CE_None);
  }
  if (spec.epsg != 0) {
    OGRSpatialReference system;
    system.importFromEPSG(spec.epsg);
    need(dataset->SetSpatialRef(&system) == CE_None);
  }
  if (spec.kind == Kind::palette) {
    GDALColorTable table;
    for (int i = 0; i < 256; ++i) {
      const GDALColorEntry entry{static_cast<short>(i), static_cast<short>(255 - i), static_cast<short>(i / 2), 255};
      table.SetColorEntry(i, &entry);
    }
    need(dataset->GetRasterBand(1)->SetColorTable(&table) == CE_None);
  }
  std::vector<std::uint8_t> line(static_cast<std::size_t>(spec.width));
  for (int band = 1; spec.nodata && band <= bands; ++band) {
    need(dataset->GetRasterBand(band)->SetNoDataValue(*spec.nodata) == CE_None);
  }
  std::vector<std::array<int, 4>> colours(line.size());
  for (int row = 0; row < spec.height; ++row) {
    for (int column = 0; column < spec.width; ++column) colours[static_cast<std::size_t>(column)] = colour(column, row);
    for (int band = 1; band <= bands; ++band) {
      std::ranges::transform(colours, line.begin(), [band](const auto& all) {
        return static_cast<std::uint8_t>(all[static_cast<std::size_t>(band - 1)]);
      });
      need(dataset->GetRasterBand(band)->RasterIO(GF_Write, 0, row, spec.width, 1, line.data(), spec.width, 1, GDT_Byte,
                                                  0, 0, nullptr) == CE_None);
    }
  }
  if (spec.masked_out) {
    need(dataset->CreateMaskBand(GMF_PER_DATASET) == CE_None);
    for (int row = 0; row < spec.height; ++row) {
      for (int column = 0; column < spec.width; ++column) {
        line[static_cast<std::size_t>(column)] = spec.masked_out(column, row) ? 0 : 255;
      }
      need(dataset->GetRasterBand(1)->GetMaskBand()->RasterIO(GF_Write, 0, row, spec.width, 1, line.data(), spec.width,
                                                              1, GDT_Byte, 0, 0, nullptr) == CE_None);
    }
  }
}

void write_item(const std::filesystem::path& raster, const std::string& datetime, double gsd_m,
                const std::string& provider) {
  std::filesystem::path item = raster;
  std::ofstream(item.replace_extension(".json")) << fmt::format(
      R"({{"type":"Feature","properties":{{"datetime":"{}","gsd":{},"providers":[{{"name":"{}"}}],"license":"CC0-1.0","nadir:ce90_m":5}}}})",
      datetime, gsd_m, provider);
}

ProjectedPoint project(int from_epsg, const char* to, ProjectedPoint point) {
  PJ* raw = proj_create_crs_to_crs(nullptr, fmt::format("EPSG:{}", from_epsg).c_str(), to, nullptr);
  if (raw == nullptr) throw std::runtime_error("PROJ cannot transform");
  PJ* transform = proj_normalize_for_visualization(nullptr, raw);
  proj_destroy(raw);
  const PJ_COORD result = proj_trans(transform, PJ_FWD, proj_coord(point.x, point.y, 0, 0));
  proj_destroy(transform);
  return {result.xy.x, result.xy.y};
}

}  // namespace nadir::test
