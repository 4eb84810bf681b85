#include "candidates/promoted_imagery.hpp"

#include <fmt/format.h>
#include <gdal_priv.h>
#include <ogr_spatialref.h>

#include <algorithm>
#include <map>
#include <nlohmann/json.hpp>
#include <opencv2/core.hpp>
#include <set>
#include <span>
#include <tuple>

#include "base/error.hpp"
#include "base/files.hpp"
#include "base/json.hpp"
#include "candidates/candidate_rules.hpp"
#include "geodesy/web_mercator.hpp"
#include "raster/gdal_dataset.hpp"
#include "raster/gdal_drivers.hpp"
#include "raster/imagery_input.hpp"

namespace nadir {
namespace fs = std::filesystem;
namespace {

// Zoom, day, block's column and row: what lies in one file.
using Sheet = std::tuple<int, std::int64_t, std::uint32_t, std::uint32_t>;

Sheet sheet_of(const PromotedTile& tile) {
  const TileKey& key = tile.promotion.key;
  return {key.z, tile.sidecar.captured_at.unix_ms / kDay_ms, key.x / kBlockTiles, key.y / kBlockTiles};
}

struct Extent {
  int zoom = 0;
  std::uint32_t left = 0, top = 0, right = 0, bottom = 0;  // tiles; the last two are outside
};

Extent extent_of(std::span<const PromotedTile* const> tiles) {
  const TileKey& first = tiles.front()->promotion.key;
  Extent extent{.zoom = first.z, .left = first.x, .top = first.y, .right = first.x + 1, .bottom = first.y + 1};
  for (const PromotedTile* tile : tiles) {
    const TileKey& key = tile->promotion.key;
    extent.left = std::min(extent.left, key.x), extent.right = std::max(extent.right, key.x + 1);
    extent.top = std::min(extent.top, key.y), extent.bottom = std::max(extent.bottom, key.y + 1);
  }
  return extent;
}

void check(bool ok, const fs::path& file) {
  if (ok) return;
  throw Error({.what = "an image cannot be written",
               .where = file,
               .found = QuietGdal::last_error(),
               .fix = "check the folder and the space on its disk"});
}

GDALDriver& driver(const char* name) {
  GDALDriver* found = GetGDALDriverManager()->GetDriverByName(name);
  if (found == nullptr)
    throw Error({.what = "GDAL lacks a driver", .expected = name, .fix = "install a GDAL that has it"});
  return *found;
}

// Bands in the order of GDAL: red, green, blue, alpha.
GdalHandle draw(std::span<const PromotedTile* const> tiles, const Extent& extent, const PackStore& packs,
                const fs::path& file) {
  const auto wide = static_cast<int>((extent.right - extent.left) * kTileSize);
  const auto high = static_cast<int>((extent.bottom - extent.top) * kTileSize);
  GdalHandle image(driver("MEM").Create("", wide, high, 4, GDT_Byte, nullptr));
  check(image != nullptr, file);
  const double pixel_m = mercator_pixel_m(extent.zoom), half_m = kMercatorHalfWorld_m;
  double place[6] = {extent.left * kTileSize * pixel_m - half_m, pixel_m, 0,
                     half_m - extent.top * kTileSize * pixel_m,  0,       -pixel_m};
  OGRSpatialReference reference;
  check(reference.importFromEPSG(3857) == OGRERR_NONE, file);
  check(image->SetGeoTransform(place) == CE_None && image->SetSpatialRef(&reference) == CE_None, file);
  image->GetRasterBand(4)->SetColorInterpretation(GCI_AlphaBand);
  for (const PromotedTile* tile : tiles) {
    const Bytes bytes = packs.read(tile->blob, tile->sidecar.sha256);
    cv::Mat image_bgr = decode_image(bytes, Colour::bgr, "a promoted tile").image;
    cv::Mat planes[4];
    cv::split(image_bgr, planes);
    std::swap(planes[0], planes[2]);
    planes[3] = cv::Mat(kTileSize, kTileSize, CV_8UC1, cv::Scalar(255));
    for (int band = 0; band < 4; ++band) {
      check(image->GetRasterBand(band + 1)->RasterIO(
                GF_Write, static_cast<int>((tile->promotion.key.x - extent.left) * kTileSize),
                static_cast<int>((tile->promotion.key.y - extent.top) * kTileSize), kTileSize, kTileSize,
                planes[band].data, kTileSize, kTileSize, GDT_Byte, 0, 0, nullptr) == CE_None,
            file);
    }
  }
  return image;
}

nlohmann::json stac_item(const ExportedImage& image, const Extent& extent, const std::set<std::string>& airframes) {
  const LonLatBox first = bounds_of({static_cast<std::uint8_t>(extent.zoom), extent.left, extent.top});
  const LonLatBox last = bounds_of({static_cast<std::uint8_t>(extent.zoom), extent.right - 1, extent.bottom - 1});
  const double west = first.west_deg, north = first.north_deg, east = last.east_deg, south = last.south_deg;
  std::string names;
  for (const std::string& airframe : airframes) names += (names.empty() ? "" : ", ") + airframe;
  const std::string name = image.file.filename();
  return {{"type", "Feature"},
          {"stac_version", "1.0.0"},
          {"id", image.file.stem().string()},
          {"bbox", {west, south, east, north}},
          {"geometry",
           {{"type", "Polygon"},
            {"coordinates", {{{west, south}, {east, south}, {east, north}, {west, north}, {west, south}}}}}},
          {"properties",
           {{"datetime", to_rfc3339(image.captured_at)},
            {"gsd", image.gsd_m},
            {"providers", {{{"name", "flights of " + names}}}},
            {"license",
             kUnknownLicence},  // whose flights they are, and what may be done with them, is the operator's to say
            {"nadir:ce90_m", image.ce90_m},
            {"nadir:tiles", image.tiles}}},
          {"assets",
           {{"image",
             {{"href", "./" + name},
              {"type", "image/tiff; application=geotiff; profile=cloud-optimized"},
              {"roles", {"data"}}}}}},
          {"links", nlohmann::json::array()}};
}

// What the agreeing flights corroborate, whatever the promoted one claims.
std::int64_t corroborated_sigma_mm(const Promotion& promotion) {
  const nlohmann::json evidence = parse_json(promotion.evidence, "the catalogue's evidence");
  const JsonReader in(evidence, {.name = to_text(promotion.key),
                                 .what = "this promotion does not state its accuracy",
                                 .fix = "it was made by an older service: have its address voted on again"});
  return in.integer("sigma_mm", 0, std::int64_t{1} << 62);
}

ExportedImage write_sheet(std::span<const PromotedTile* const> tiles, const PackStore& packs, const fs::path& folder) {
  const auto [zoom, day, column, row] = sheet_of(*tiles.front());
  ExportedImage image{.tiles = tiles.size(), .captured_at = {tiles.front()->sidecar.captured_at.unix_ms / 1000}};
  std::int64_t sigma_mm = 0, gsd_mm = 0;
  std::set<std::string> airframes;
  for (const PromotedTile* tile : tiles) {
    image.captured_at = std::min(image.captured_at, UtcTime{tile->sidecar.captured_at.unix_ms / 1000});
    sigma_mm = std::max({sigma_mm, tile->sidecar.pose.sigma_mm, corroborated_sigma_mm(tile->promotion)});
    gsd_mm = std::max(gsd_mm, tile->sidecar.gsd_mm);
    airframes.insert(tile->sidecar.airframe);
  }
  image.gsd_m = static_cast<double>(gsd_mm) / 1000;
  image.ce90_m = kCe90OverSigma * static_cast<double>(sigma_mm) / 1000;
  image.file = folder / fmt::format("promoted-z{}-{}-{}-{}.tif", zoom,
                                    to_rfc3339(UtcTime{day * kDay_ms / 1000}).substr(0, 10), column, row);
  const Extent extent = extent_of(tiles);
  const GdalHandle drawn = draw(tiles, extent, packs, image.file);
  const char* const options[] = {"COMPRESS=DEFLATE", "PREDICTOR=YES", "OVERVIEWS=NONE", nullptr};
  const GdalHandle written(
      driver("COG").CreateCopy(image.file.c_str(), drawn.get(), 1, const_cast<char**>(options), nullptr, nullptr));
  check(written != nullptr, image.file);
  write_file_atomic(stac_item_beside(image.file), stac_item(image, extent, airframes).dump(2) + "\n");
  return image;
}

}  // namespace

std::vector<ExportedImage> write_promoted(std::vector<PromotedTile> tiles, const PackStore& packs,
                                          const fs::path& folder, Progress& progress) {
  register_gdal_drivers();
  const QuietGdal quiet;
  std::map<Sheet, std::vector<const PromotedTile*>> sheets;
  for (const PromotedTile& tile : tiles) sheets[sheet_of(tile)].push_back(&tile);
  std::vector<ExportedImage> images;
  progress.begin("exporting", tiles.size(), "tiles");
  for (const auto& [sheet, of_sheet] : sheets) {
    images.push_back(write_sheet(of_sheet, packs, folder));
    progress.advance(of_sheet.size());
  }
  progress.end();
  return images;
}

}  // namespace nadir
