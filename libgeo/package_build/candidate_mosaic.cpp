#include "package_build/candidate_mosaic.hpp"

#include <fmt/format.h>
#include <gdal_priv.h>
#include <ogr_spatialref.h>

#include <algorithm>
#include <array>
#include <limits>
#include <opencv2/imgproc.hpp>
#include <vector>

#include "base/error.hpp"
#include "base/files.hpp"
#include "geodesy/web_mercator.hpp"
#include "imagery/codecs.hpp"
#include "ortho/candidate_store.hpp"
#include "raster/gdal_dataset.hpp"
#include "raster/gdal_drivers.hpp"

namespace nadir {
namespace {

struct TileBox {
  int zoom = 0;
  std::uint32_t west = std::numeric_limits<std::uint32_t>::max(), north = west, east = 0, south = 0;  // inclusive
  std::uint64_t tiles = 0;
};

TileBox box_of(const std::filesystem::path& folder) {
  CandidateReader reader(folder);
  Findings damaged;
  TileBox box;
  while (const auto candidate = reader.next(damaged)) {
    const TileKey& key = candidate->sidecar.key;
    if (box.tiles > 0 && key.z != box.zoom) {
      throw Error({.what = "candidate tiles of different zooms cannot form one mosaic", .where = folder.string()});
    }
    box.zoom = key.z;
    box.west = std::min(box.west, key.x), box.east = std::max(box.east, key.x);
    box.north = std::min(box.north, key.y), box.south = std::max(box.south, key.y);
    ++box.tiles;
  }
  if (box.tiles == 0) {
    throw Error({.what = "there are no candidate tiles for a mosaic",
                 .where = folder.string(),
                 .fix = "`nadir ortho` lists why frames and tiles were rejected"});
  }
  return box;
}

// Copies every candidate tile into the image, and marks it as opaque.
void paint(const std::filesystem::path& folder, const TileBox& box, int halvings, cv::Mat& image, cv::Mat& mask,
           Progress& progress) {
  const int side = kTileSize >> halvings;
  CandidateReader reader(folder);
  Findings damaged;
  progress.begin("mosaic", box.tiles, "tiles");
  while (const auto candidate = reader.next(damaged)) {
    const TileKey& key = candidate->sidecar.key;
    cv::Mat tile = decode_image(candidate->tile, Colour::bgr, to_text(key)).image;
    if (side != tile.cols) cv::resize(tile, tile, {side, side}, 0, 0, cv::INTER_AREA);
    const cv::Rect place(static_cast<int>(key.x - box.west) * side, static_cast<int>(key.y - box.north) * side, side,
                         side);
    tile.copyTo(image(place));
    mask(place).setTo(255);
    progress.advance(1);
  }
  progress.end();
}

}  // namespace

CandidateMosaic write_candidate_mosaic(const std::filesystem::path& folder, const std::filesystem::path& path,
                                       Progress& progress, std::int64_t max_pixels) {
  const TileBox box = box_of(folder);
  const std::int64_t columns = std::int64_t{box.east} - box.west + 1, rows = std::int64_t{box.south} - box.north + 1;
  int halvings = 0;
  while (halvings < 7 && columns * rows * (kTileSize >> halvings) * (kTileSize >> halvings) > max_pixels) ++halvings;
  const int side = kTileSize >> halvings;
  if (columns * rows * side * side > max_pixels) {
    throw UsageError({.what = "the candidate tiles are too far apart for one image",
                      .where = folder.string(),
                      .expected = fmt::format("at most {} pixels", max_pixels),
                      .found = fmt::format("{} x {} tiles", columns, rows)});
  }
  CandidateMosaic mosaic{box.zoom - halvings, static_cast<int>(columns) * side, static_cast<int>(rows) * side,
                         box.tiles};
  cv::Mat image(mosaic.height, mosaic.width, CV_8UC3, cv::Scalar::all(0)), mask(mosaic.height, mosaic.width, CV_8UC1);
  mask.setTo(0);
  paint(folder, box, halvings, image, mask, progress);

  register_gdal_drivers();
  const QuietGdal quiet;
  const auto need = [&](bool ok) {
    if (ok) return;
    throw Error({.what = "the mosaic cannot be written", .where = path.string(), .found = QuietGdal::last_error()});
  };
  GDALDriver* memory = GetGDALDriverManager()->GetDriverByName("MEM");
  GDALDriver* cog = GetGDALDriverManager()->GetDriverByName("COG");
  need(memory != nullptr && cog != nullptr);
  const GdalHandle raster(memory->Create("", mosaic.width, mosaic.height, 3, GDT_Byte, nullptr));
  need(raster != nullptr);
  const double pixel_m = mercator_pixel_m(mosaic.zoom);
  const MercatorXY corner = mercator_from_lonlat(lonlat_from_pixel(
      {static_cast<double>(box.west) * kTileSize, static_cast<double>(box.north) * kTileSize}, box.zoom));
  std::array<double, 6> transform{corner.x_m, pixel_m, 0, corner.y_m, 0, -pixel_m};
  OGRSpatialReference system;
  need(system.importFromEPSG(3857) == OGRERR_NONE && raster->SetGeoTransform(transform.data()) == CE_None &&
       raster->SetSpatialRef(&system) == CE_None && raster->CreateMaskBand(GMF_PER_DATASET) == CE_None);
  constexpr std::array<GDALColorInterp, 3> kColours{GCI_RedBand, GCI_GreenBand, GCI_BlueBand};
  for (int band = 0; band < 3; ++band) {
    GDALRasterBand* target = raster->GetRasterBand(band + 1);
    need(target->SetColorInterpretation(kColours[static_cast<std::size_t>(band)]) == CE_None &&
         target->RasterIO(GF_Write, 0, 0, mosaic.width, mosaic.height, image.data + (2 - band), mosaic.width,
                          mosaic.height, GDT_Byte, 3, static_cast<GSpacing>(image.step[0]), nullptr) == CE_None);
  }
  need(raster->GetRasterBand(1)->GetMaskBand()->RasterIO(GF_Write, 0, 0, mosaic.width, mosaic.height, mask.data,
                                                         mosaic.width, mosaic.height, GDT_Byte, 0, 0,
                                                         nullptr) == CE_None);
  std::array<const char*, 7> options{
      "COMPRESS=JPEG", "QUALITY=85",       "BLOCKSIZE=256", "OVERVIEW_RESAMPLING=AVERAGE",
      "NUM_THREADS=1", "BIGTIFF=IF_SAFER", nullptr};
  // In the same folder, so that the file is replaced by a rename.
  StagingDirectory staging(std::filesystem::absolute(path).parent_path() /
                           ("." + path.filename().string() + ".mosaic"));
  const std::filesystem::path file = staging.path() / "mosaic.tif";
  GdalHandle written(
      cog->CreateCopy(file.c_str(), raster.get(), 0, const_cast<char**>(options.data()), nullptr, nullptr));
  need(written != nullptr);
  CPLErrorReset();
  written.reset();
  need(CPLGetLastErrorType() < CE_Failure);
  std::filesystem::rename(file, path);
  return mosaic;
}

}  // namespace nadir
