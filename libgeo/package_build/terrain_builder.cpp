#include "package_build/terrain_builder.hpp"

#include <fmt/format.h>
#include <gdal_alg.h>
#include <gdal_priv.h>
#include <gdal_utils.h>
#include <ogr_spatialref.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <memory>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "base/error.hpp"
#include "geodesy/angles.hpp"
#include "geodesy/web_mercator.hpp"
#include "package/manifest.hpp"
#include "raster/gdal_dataset.hpp"
#include "raster/imagery_input.hpp"
#include "raster/pinned_files.hpp"

namespace nadir {
namespace {

namespace fs = std::filesystem;

constexpr float kNodata = -32767;
constexpr double kMetresPerDegree = 111'320;  // of latitude; precise enough for the grid's step
constexpr double kCoarsest_m = 20'000;

// The file of a dataset, for messages.
struct Source {
  fs::path path;
  GdalHandle dataset;

  // What went wrong with a pinned object, whatever GDAL made of it.
  void require_sound() const {
    if (const PinnedObject* object = mounted_object(path)) object->require_sound();
  }

  [[noreturn]] void reject(std::string expected, std::string found, std::string fix) const {
    throw UsageError({.what = "this elevation model cannot be used",
                      .where = path.string(),
                      .expected = std::move(expected),
                      .found = std::move(found),
                      .fix = std::move(fix)});
  }
};

bool is_metre(const char* unit) {
  const std::string name = unit == nullptr ? "" : unit;
  return name.empty() || name == "m" || name == "metre" || name == "meter" || name == "metres" || name == "meters";
}

void check_source(const Source& source) {
  if (source.dataset->GetRasterCount() != 1) {
    source.reject("a raster with one band, of heights", fmt::format("{} bands", source.dataset->GetRasterCount()),
                  "extract the band with the heights: gdal_translate -b 1 IN.tif OUT.tif");
  }
  GDALRasterBand* band = source.dataset->GetRasterBand(1);
  if (GDALDataTypeIsComplex(band->GetRasterDataType()) != 0 || band->GetColorTable() != nullptr) {
    source.reject("a band of heights", "an image", "pass the elevation model, not an image of it");
  }
  if (!is_metre(band->GetUnitType())) {
    source.reject("heights in metres", fmt::format("the unit \"{}\"", band->GetUnitType()),
                  "convert it: gdal_calc.py -A IN.tif --calc='A*0.3048' --outfile=OUT.tif");
  }
  std::array<double, 6> transform{};
  const bool placed = source.dataset->GetGeoTransform(transform.data()) == CE_None || source.dataset->GetGCPCount() > 0;
  if (!placed || (source.dataset->GetSpatialRef() == nullptr && source.dataset->GetGCPSpatialRef() == nullptr)) {
    source.reject("a georeferenced raster", "no coordinate system or no geotransform",
                  "set them: gdal_translate -a_srs EPSG:… -a_ullr WEST NORTH EAST SOUTH IN OUT.tif");
  }
}

OGRSpatialReference wgs84() {
  OGRSpatialReference system;
  system.importFromEPSG(4326);
  system.SetAxisMappingStrategy(OAMS_TRADITIONAL_GIS_ORDER);
  return system;
}

// The geotransform of a source that is a grid of longitude and latitude already: its posts are copied.
std::optional<std::array<double, 6>> own_grid(GDALDataset& dataset) {
  std::array<double, 6> transform{};
  const OGRSpatialReference* system = dataset.GetSpatialRef();
  if (system == nullptr || dataset.GetGeoTransform(transform.data()) != CE_None) return std::nullopt;
  const std::array<const char*, 3> lenient{"IGNORE_DATA_AXIS_TO_SRS_AXIS_MAPPING=YES",
                                           "CRITERION=EQUIVALENT_EXCEPT_AXIS_ORDER_GEOGCRS", nullptr};
  const OGRSpatialReference degrees = wgs84();
  const bool north_up = transform[1] > 0 && transform[5] < 0 && transform[2] == 0 && transform[4] == 0;
  if (!north_up || system->IsSame(&degrees, lenient.data()) == 0) return std::nullopt;
  return transform;
}

// Side of a source pixel on the ground around a position, from the length of a small step in source pixels.
std::optional<double> pixel_side_m(GDALDataset& dataset, LonLat place) {
  const std::unique_ptr<char*, void (*)(char**)> options(CSLSetNameValue(nullptr, "DST_SRS", "EPSG:4326"), CSLDestroy);
  const std::unique_ptr<void, void (*)(void*)> transformer(
      GDALCreateGenImgProjTransformer2(GDALDataset::ToHandle(&dataset), nullptr, options.get()),
      GDALDestroyGenImgProjTransformer);
  if (!transformer) return std::nullopt;
  constexpr double kStep_m = 20;
  const double lat_deg = kStep_m / kMetresPerDegree, lon_deg = lat_deg / std::cos(radians(place.lat_deg));
  std::array<double, 3> x{place.lon_deg, place.lon_deg + lon_deg, place.lon_deg};
  std::array<double, 3> y{place.lat_deg, place.lat_deg, place.lat_deg + lat_deg};
  std::array<double, 3> z{};
  std::array<int, 3> done{};
  GDALGenImgProjTransform(transformer.get(), 1, 3, x.data(), y.data(), z.data(), done.data());
  if (std::count(done.begin(), done.end(), 0) > 0) return std::nullopt;
  const double pixels = std::abs((x[1] - x[0]) * (y[2] - y[0]) - (x[2] - x[0]) * (y[1] - y[0]));
  if (!(pixels > 0) || !std::isfinite(pixels)) return std::nullopt;
  return kStep_m / std::sqrt(pixels);
}

struct TerrainPlan {
  TerrainGrid grid;
  const char* resampling = "bilinear";

  bool finer_than(const TerrainPlan& other) const {
    return std::pair(grid.lat_step_deg, grid.lon_step_deg) <
           std::pair(other.grid.lat_step_deg, other.grid.lon_step_deg);
  }
};

// Posts of one are posts of the other, where both have some.
bool same_posts(const TerrainGrid& a, const TerrainGrid& b) {
  constexpr double kShare = 1e-3;  // of a step, over the whole grid
  const auto whole = [](double steps) { return std::abs(steps - std::round(steps)) < kShare; };
  return std::abs(a.lon_step_deg / b.lon_step_deg - 1) * a.columns < kShare &&
         std::abs(a.lat_step_deg / b.lat_step_deg - 1) * a.rows < kShare &&
         whole((a.west_deg - b.west_deg) / b.lon_step_deg) && whole((a.north_deg - b.north_deg) / b.lat_step_deg);
}

// Rounded outwards to whole steps from the origin, so that every package of a source has the same posts.
void span(double low, double high, double origin, double step, double& first, int& count) {
  const double from = std::floor((low - origin) / step + 1e-9), to = std::ceil((high - origin) / step - 1e-9);
  first = origin + from * step;
  count = static_cast<int>(std::clamp(to - from, 1.0, 1e6));
}

TerrainPlan plan_grid(GDALDataset& dataset, const Mission& mission) {
  LonLatBox box = manifest_for(mission).bounds;
  const LonLat centre{(box.west_deg + box.east_deg) / 2, (box.south_deg + box.north_deg) / 2};
  const double narrowing = std::cos(radians(centre.lat_deg));
  const double lat_margin = kTerrainMargin_m / kMetresPerDegree, lon_margin = lat_margin / narrowing;
  box = {std::max(-180.0, box.west_deg - lon_margin), std::max(-90.0, box.south_deg - lat_margin),
         std::min(180.0, box.east_deg + lon_margin), std::min(90.0, box.north_deg + lat_margin)};

  TerrainPlan plan;
  TerrainGrid& grid = plan.grid;
  double lon_origin = 0, lat_origin = 0;
  const auto own = own_grid(dataset);
  constexpr double kNearly = 0.9;  // models sold as 10 m have 9.3 m in one direction
  if (own && -(*own)[5] * kMetresPerDegree >= kNearly * kFinestTerrain_m &&
      (*own)[1] * kMetresPerDegree * narrowing >= kNearly * kFinestTerrain_m) {
    grid.lon_step_deg = (*own)[1], grid.lat_step_deg = -(*own)[5];
    lon_origin = (*own)[0], lat_origin = (*own)[3];
    plan.resampling = "near";  // post on post: a copy
  } else {
    const double source_m = pixel_side_m(dataset, centre).value_or(kFinestTerrain_m);
    const double step_m = std::clamp(source_m, kFinestTerrain_m, kCoarsest_m);
    grid.lat_step_deg = std::round(step_m / kMetresPerDegree * 1e9) / 1e9;
    grid.lon_step_deg = std::round(step_m / kMetresPerDegree / narrowing * 1e9) / 1e9;
    if (step_m > 1.5 * source_m) plan.resampling = "average";
  }
  double first_south = 0;
  span(box.west_deg, box.east_deg, lon_origin, grid.lon_step_deg, grid.west_deg, grid.columns);
  span(box.south_deg, box.north_deg, lat_origin, grid.lat_step_deg, first_south, grid.rows);
  grid.north_deg = first_south + grid.rows * grid.lat_step_deg;
  return plan;
}

void check_size(const Source& source, const TerrainGrid& grid) {
  if (grid.columns <= kMaxTerrainSide && grid.rows <= kMaxTerrainSide && grid.posts() <= kMaxTerrainPosts) return;
  source.reject(
      fmt::format("at most {} posts a side and {} in all over the mission's area", kMaxTerrainSide, kMaxTerrainPosts),
      fmt::format("{} x {}", grid.columns, grid.rows), "resample it first: gdalwarp -tr … -r average IN.tif OUT.tif");
}

GdalHandle warp(const Source& source, const TerrainPlan& plan) {
  const TerrainGrid& grid = plan.grid;
  const auto number = [](double value) { return fmt::format("{}", value); };  // shortest text that reads back the same
  std::vector<std::string> words{"-of",
                                 "MEM",
                                 "-t_srs",
                                 "EPSG:4326",
                                 "-te",
                                 number(grid.west_deg),
                                 number(grid.south_deg()),
                                 number(grid.east_deg()),
                                 number(grid.north_deg),
                                 "-ts",
                                 std::to_string(grid.columns),
                                 std::to_string(grid.rows),
                                 "-r",
                                 plan.resampling,
                                 "-ot",
                                 "Float32",
                                 "-dstnodata",
                                 number(static_cast<double>(kNodata)),
                                 "-et",
                                 "0.001",
                                 "-wm",
                                 "64",
                                 "-novshift"};
  std::vector<char*> pointers;
  for (std::string& word : words) pointers.push_back(word.data());
  pointers.push_back(nullptr);
  const std::unique_ptr<GDALWarpAppOptions, void (*)(GDALWarpAppOptions*)> options(
      GDALWarpAppOptionsNew(pointers.data(), nullptr), GDALWarpAppOptionsFree);
  std::array<GDALDatasetH, 1> inputs{GDALDataset::ToHandle(source.dataset.get())};
  int misused = 0;
  CPLErrorReset();
  GdalHandle warped(GDALDataset::FromHandle(GDALWarp("", nullptr, 1, inputs.data(), options.get(), &misused)));
  source.require_sound();
  if (!warped || CPLGetLastErrorType() >= CE_Failure) {
    throw Error({.what = "the elevation model cannot be read",
                 .where = source.path.string(),
                 .expected = "a complete raster that can be transformed to longitude and latitude",
                 .found = QuietGdal::last_error(),
                 .fix = "download the file again; `gdalinfo -checksum` shows whether it is complete"});
  }
  return warped;
}

// Applies the source's scale and offset. Missing is what GDAL could not fill, and what is not finite.
std::vector<float> heights_of(const Source& source, GDALDataset& warped, const TerrainGrid& grid) {
  std::vector<float> heights(grid.posts());
  if (warped.GetRasterBand(1)->RasterIO(GF_Read, 0, 0, grid.columns, grid.rows, heights.data(), grid.columns, grid.rows,
                                        GDT_Float32, 0, 0, nullptr) != CE_None) {
    throw Error({.what = "the elevation model cannot be read",
                 .where = source.path.string(),
                 .found = QuietGdal::last_error()});
  }
  int scaled = 0, shifted = 0;
  GDALRasterBand* band = source.dataset->GetRasterBand(1);
  const double scale = band->GetScale(&scaled), offset = band->GetOffset(&shifted);
  for (float& height : heights) {
    if (height == kNodata || !std::isfinite(height)) {
      height = std::numeric_limits<float>::quiet_NaN();
    } else if (scaled != 0 || shifted != 0) {
      height =
          static_cast<float>(static_cast<double>(height) * (scaled != 0 ? scale : 1) + (shifted != 0 ? offset : 0));
    }
  }
  return heights;
}

void throw_if_out_of_space(const fs::path& path, std::uintmax_t needed) {
  std::error_code unknown;
  const fs::space_info space = fs::space(path.parent_path(), unknown);
  if (unknown || space.available >= needed) return;
  throw OutOfSpace({.what = "the terrain file cannot be written",
                    .where = path.string(),
                    .expected = fmt::format("about {} bytes free", needed),
                    .found = fmt::format("{} bytes", space.available),
                    .fix = "free space on this disk, or write elsewhere"});
}

}  // namespace

// One model is open at a time: a list may have thousands.
TerrainRaster cut_terrain(std::span<const fs::path> dem, const Mission& mission) {
  std::vector<std::pair<fs::path, TerrainPlan>> models;
  for (const fs::path& named : dem) {
    for (const StacAsset& asset : named_rasters(named)) {
      const Source source{asset.href, open_gdal_raster(asset.href)};
      const QuietGdal quiet;
      check_source(source);
      models.emplace_back(source.path, plan_grid(*source.dataset, mission));
    }
  }
  const auto& [finest_path, finest] = *std::min_element(
      models.begin(), models.end(), [](const auto& a, const auto& b) { return a.second.finer_than(b.second); });
  const TerrainGrid grid = finest.grid;
  check_size({finest_path, {}}, grid);
  const QuietGdal quiet;
  std::vector<float> heights(grid.posts(), std::numeric_limits<float>::quiet_NaN());
  for (const auto& [path, plan] : models) {
    if (std::none_of(heights.begin(), heights.end(), [](float height) { return std::isnan(height); })) break;
    const Source source{path, open_gdal_raster(path)};
    const bool posts_move = !same_posts(plan.grid, grid) && std::string_view(plan.resampling) == "near";
    const GdalHandle warped = warp(source, {grid, posts_move ? "bilinear" : plan.resampling});
    const std::vector<float> below = heights_of(source, *warped, grid);
    std::transform(heights.begin(), heights.end(), below.begin(), heights.begin(),
                   [](float above, float height) { return std::isnan(above) ? height : above; });
  }
  return {grid, std::move(heights)};
}

void write_terrain(const TerrainRaster& terrain, const fs::path& path) {
  const QuietGdal quiet;
  const TerrainGrid& grid = terrain.grid();
  const auto need = [&](bool ok) {
    if (!ok) {
      // GDAL reports neither errno nor a full disk.
      throw_if_out_of_space(path, static_cast<std::uintmax_t>(grid.posts()) * sizeof(float));
      throw Error(
          {.what = "the terrain file cannot be written", .where = path.string(), .found = QuietGdal::last_error()});
    }
  };
  std::vector<float> heights(terrain.heights_m().begin(), terrain.heights_m().end());
  for (float& height : heights) height = std::isnan(height) ? kNodata : height;
  GDALDriver* memory = GetGDALDriverManager()->GetDriverByName("MEM");
  GDALDriver* tiff = GetGDALDriverManager()->GetDriverByName("GTiff");
  need(memory != nullptr && tiff != nullptr);
  const GdalHandle raster(memory->Create("", grid.columns, grid.rows, 1, GDT_Float32, nullptr));
  need(raster != nullptr);
  std::array<double, 6> transform{grid.west_deg, grid.lon_step_deg, 0, grid.north_deg, 0, -grid.lat_step_deg};
  const OGRSpatialReference system = wgs84();
  GDALRasterBand* band = raster->GetRasterBand(1);
  need(raster->SetGeoTransform(transform.data()) == CE_None && raster->SetSpatialRef(&system) == CE_None &&
       band->SetNoDataValue(static_cast<double>(kNodata)) == CE_None);
  need(band->RasterIO(GF_Write, 0, 0, grid.columns, grid.rows, heights.data(), grid.columns, grid.rows, GDT_Float32, 0,
                      0, nullptr) == CE_None);
  std::array<const char*, 9> options{"TILED=YES",        "BLOCKXSIZE=256",      "BLOCKYSIZE=256",
                                     "COMPRESS=DEFLATE", "PREDICTOR=3",         "ZLEVEL=6",
                                     "NUM_THREADS=1",    "GEOTIFF_VERSION=1.1", nullptr};
  GdalHandle file(
      tiff->CreateCopy(path.c_str(), raster.get(), 0, const_cast<char**>(options.data()), nullptr, nullptr));
  need(file != nullptr);
  CPLErrorReset();
  file.reset();
  need(CPLGetLastErrorType() < CE_Failure);
}

}  // namespace nadir
