#include "package_build/matchability_survey.hpp"

#include <cpl_vsi.h>
#include <fmt/format.h>
#include <gdal_priv.h>
#include <ogr_spatialref.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <memory>
#include <numeric>
#include <opencv2/core.hpp>
#include <utility>
#include <vector>

#include "base/error.hpp"
#include "base/files.hpp"
#include "base/quantile.hpp"
#include "imagery/map_window.hpp"
#include "raster/gdal_dataset.hpp"
#include "raster/gdal_drivers.hpp"

namespace nadir {
namespace {

constexpr int kSamples = 5;        // per side of a cell: it is needed when one of 5 x 5 samples is
constexpr int kRouteSamples = 20;  // of the route per side of a cell
constexpr std::size_t kCachedTiles = 128;
constexpr std::size_t kTextureSamples = 200;

MatchabilityGrid grid_over(const Region& region, const LocalFrame& frame, int zoom, double step_m) {
  const PlaneBox box = region.bounds();
  MatchabilityGrid grid;
  grid.zoom = zoom;
  grid.step_px = std::max(
      1, static_cast<int>(std::lround(std::min(1e9, step_m / ground_resolution_m(zoom, frame.origin().lat_deg)))));
  double west = 1e300, north = 1e300, east = -1e300, south = -1e300;
  for (const double x : {box.west_m, box.east_m}) {
    for (const double y : {box.south_m, box.north_m}) {
      const GlobalPixel corner = pixel_from_lonlat(frame.lonlat_from_plane({x, y}), zoom);
      west = std::min(west, corner.x), east = std::max(east, corner.x);
      north = std::min(north, corner.y), south = std::max(south, corner.y);
    }
  }
  const auto cell = [&](double pixel) { return static_cast<std::int64_t>(std::floor(pixel / grid.step_px)); };
  grid.first_column = cell(west);
  grid.first_row = cell(north);
  const auto columns = static_cast<std::uint64_t>(cell(east) - grid.first_column + 1);
  const auto rows = static_cast<std::uint64_t>(cell(south) - grid.first_row + 1);
  if (columns > kMaxMatchabilityCells || rows > kMaxMatchabilityCells || columns * rows > kMaxMatchabilityCells) {
    throw UsageError({.what = "the matchability map would have too many cells",
                      .expected = fmt::format("at most {} cells", kMaxMatchabilityCells),
                      .found = fmt::format("{} x {}", columns, rows),
                      .fix = "use a larger --step-m"});
  }
  grid.columns = static_cast<int>(columns);
  grid.rows = static_cast<int>(rows);
  return grid;
}

// Cells that overlap the region, and those that a route crosses, however narrow its corridor.
std::vector<std::size_t> needed_cells(const MatchabilityGrid& grid, const Region& region, const LocalFrame& frame,
                                      double step_m) {
  std::vector<char> needed(grid.cells(), 0);
  const auto index = [&](int column, int row) {
    return static_cast<std::size_t>(row) * static_cast<std::size_t>(grid.columns) + static_cast<std::size_t>(column);
  };
  const auto asked = [&](double column, double row) {
    return region.contains(frame.plane_from_lonlat(grid.lonlat_at(column, row)));
  };
  for (int row = 0; row < grid.rows; ++row) {
    for (int column = 0; column < grid.columns; ++column) {
      char& cell = needed[index(column, row)];
      for (int i = 0; i < kSamples * kSamples && cell == 0; ++i) {
        const double right = (i % kSamples + 0.5) / kSamples, down = (i / kSamples + 0.5) / kSamples;
        cell = asked(column + right, row + down) ? 1 : 0;
      }
    }
  }
  const auto touch = [&](PlanePoint point) {
    const GlobalPixel pixel = pixel_from_lonlat(frame.lonlat_from_plane(point), grid.zoom);
    const double column = std::floor(pixel.x / grid.step_px) - static_cast<double>(grid.first_column);
    const double row = std::floor(pixel.y / grid.step_px) - static_cast<double>(grid.first_row);
    if (column < 0 || row < 0 || column >= grid.columns || row >= grid.rows) return;
    needed[index(static_cast<int>(column), static_cast<int>(row))] = 1;
  };
  for (const Corridor& corridor : region.corridors) {
    for (std::size_t i = 1; i < corridor.path.size(); ++i) {
      const PlanePoint a = corridor.path[i - 1], b = corridor.path[i];
      const double length_m = distance_m(a, b);
      const int steps = std::max(1, static_cast<int>(std::ceil(length_m / step_m * kRouteSamples)));
      for (int k = 0; k <= steps; ++k) {
        const double share = static_cast<double>(k) / steps;
        touch(a + share * (b - a));
      }
    }
  }
  std::vector<std::size_t> cells;
  for (std::size_t i = 0; i < needed.size(); ++i) {
    if (needed[i] != 0) cells.push_back(i);
  }
  return cells;
}

LonLat centre_of(const MatchabilityGrid& grid, std::size_t cell) {
  const auto columns = static_cast<std::size_t>(grid.columns);
  return grid.lonlat_at(static_cast<double>(cell % columns) + 0.5, static_cast<double>(cell / columns) + 0.5);
}

PlaneBox box_around(const LocalFrame& frame, LonLat position, double reach_m) {
  const PlanePoint centre = frame.plane_from_lonlat(position);
  return {centre.east_m - reach_m, centre.north_m - reach_m, centre.east_m + reach_m, centre.north_m + reach_m};
}

// The options with the median texture of cells that are spread evenly over the grid.
MatchabilityOptions with_typical_texture(const TileSource& tiles, const LocalFrame& frame, const MatchabilityGrid& grid,
                                         const std::vector<std::size_t>& needed, MatchabilityOptions options) {
  MapWindowReader reader(tiles, kCachedTiles);
  std::vector<double> textures;
  const std::size_t stride = std::max<std::size_t>(1, needed.size() / kTextureSamples);
  for (std::size_t i = 0; i < needed.size(); i += stride) {
    const PlaneBox box = box_around(frame, centre_of(grid, needed[i]), options.footprint_m / 2);
    const MapWindow window = reader.read(frame, box, options.gsd_m, Colour::grey);
    if (cv::countNonZero(window.mask) == 0) continue;
    textures.push_back(MatchabilityProbe::texture_of(window.image, window.mask));
  }
  if (textures.empty()) return options;
  options.typical_texture = median(std::move(textures));
  return options;
}

}  // namespace

LonLat MatchabilityGrid::lonlat_at(double column, double row) const {
  return lonlat_from_pixel(
      {(static_cast<double>(first_column) + column) * step_px, (static_cast<double>(first_row) + row) * step_px}, zoom);
}

const PlaceMatchability* MatchabilityMap::at(LonLat position) const {
  const GlobalPixel pixel = pixel_from_lonlat(position, grid.zoom);
  const auto column = static_cast<std::int64_t>(std::floor(pixel.x / grid.step_px)) - grid.first_column;
  const auto row = static_cast<std::int64_t>(std::floor(pixel.y / grid.step_px)) - grid.first_row;
  if (column < 0 || row < 0 || column >= grid.columns || row >= grid.rows) return nullptr;
  const PlaceMatchability& cell =
      cells[static_cast<std::size_t>(row) * static_cast<std::size_t>(grid.columns) + static_cast<std::size_t>(column)];
  return cell.cls == MatchClass::outside ? nullptr : &cell;
}

namespace {

constexpr std::size_t kPlaceNumbers = 5;

}  // namespace

Bytes serialize_place(const PlaceMatchability& place) {
  Bytes bytes{static_cast<std::uint8_t>(place.cls)};
  for (const double value : {place.ratio, place.score, place.entropy, place.texture, place.valid}) {
    const auto bits = std::bit_cast<std::uint64_t>(value);
    for (int shift = 0; shift < 64; shift += 8) bytes.push_back(static_cast<std::uint8_t>(bits >> shift));
  }
  return bytes;
}

std::optional<PlaceMatchability> parse_place(ByteView bytes) {
  if (bytes.size() != 1 + 8 * kPlaceNumbers) return std::nullopt;
  PlaceMatchability place;
  place.cls = static_cast<MatchClass>(bytes[0]);
  if (place.cls != MatchClass::good && place.cls != MatchClass::weak && place.cls != MatchClass::poor) {
    return std::nullopt;
  }
  const std::array<double*, kPlaceNumbers> values{&place.ratio, &place.score, &place.entropy, &place.texture,
                                                  &place.valid};
  for (std::size_t i = 0; i < values.size(); ++i) {
    std::uint64_t bits = 0;
    for (std::size_t byte = 8; byte > 0; --byte) bits = bits << 8 | bytes[8 * i + byte];
    *values[i] = std::bit_cast<double>(bits);
    if (!std::isfinite(*values[i])) return std::nullopt;
  }
  return place;
}

MatchabilitySurvey::MatchabilitySurvey(const SurveyedGround& ground, const MatchabilityOptions& options)
    : ground_(ground),
      map_{grid_over(ground.region, ground.frame, ground.zoom, ground.step_m), {}},
      needed_(needed_cells(map_.grid, ground.region, ground.frame, ground.step_m)),
      probe_(with_typical_texture(ground.tiles, ground.frame, map_.grid, needed_, options)) {
  map_.cells.resize(map_.grid.cells());
}

std::string MatchabilitySurvey::description() const {
  const MatchabilityGrid& grid = map_.grid;
  const MatchabilityOptions& options = probe_.options();
  return fmt::format("cells: {} of {} x {}, {} pixels of zoom {} each, from {} {}\n", needed_.size(), grid.columns,
                     grid.rows, grid.step_px, grid.zoom, grid.first_column, grid.first_row) +
         fmt::format("search: footprint {} m, {} m per pixel, {} m around, distinct {} m, texture {}, seed {}\n",
                     options.footprint_m, options.gsd_m, options.radius_m, options.distinct_m, options.typical_texture,
                     options.seed) +
         fmt::format("limits: ratio {} {}, score {}, valid {}\n", options.limits.good_ratio, options.limits.weak_ratio,
                     options.limits.min_score, options.limits.min_valid);
}

SharedWork::Worker MatchabilitySurvey::make_worker() const {
  return [this, reader = std::make_shared<MapWindowReader>(ground_.tiles, kCachedTiles)](std::size_t task) {
    const MatchabilityGrid& grid = map_.grid;
    const std::size_t cell = needed_[task];
    const PlaneBox box = box_around(ground_.frame, centre_of(grid, cell), probe_.reach_m());
    const MapWindow window = reader->read(ground_.frame, box, probe_.options().gsd_m, Colour::grey);
    // The noise seed is the cell's index in the world: it does not depend on the extent of the survey.
    const auto columns = static_cast<std::uint64_t>(grid.columns);
    const std::uint64_t column = cell % columns, row = cell / columns;
    const std::uint64_t number = (static_cast<std::uint64_t>(grid.first_row) + row) << 32U |
                                 (static_cast<std::uint64_t>(grid.first_column) + column);
    return serialize_place(probe_.probe(window, number));
  };
}

bool MatchabilitySurvey::add(std::size_t task, ByteView result) {
  const auto place = parse_place(result);
  if (place) map_.cells[needed_[task]] = *place;
  return place.has_value();
}

MatchabilityMap survey_matchability(const TileSource& tiles, const Region& region, const LocalFrame& frame, int zoom,
                                    double step_m, const MatchabilityOptions& options, int threads,
                                    Progress& progress) {
  MatchabilitySurvey survey({tiles, region, frame, zoom, step_m}, options);
  do_alone(survey, threads, progress);
  return survey.take();
}

namespace {

constexpr double kRouteStep_m = 5;  // sampling of the route; cells are tens of metres wide

std::size_t index_of(MatchClass cls) { return static_cast<std::size_t>(cls); }

class RouteSampler {
 public:
  RouteSampler(const MatchabilityMap& map, const LocalFrame& frame, MatchabilitySummary& summary)
      : map_(map), frame_(frame), summary_(summary) {}

  void add_leg(PlanePoint from, PlanePoint to) {
    const double length = distance_m(from, to);
    const int steps = std::max(1, static_cast<int>(std::ceil(length / kRouteStep_m)));
    const auto along = [&](double share) { return frame_.lonlat_from_plane(from + share * (to - from)); };
    for (int i = 0; i < steps; ++i) {
      const PlaceMatchability* place = map_.at(along((i + 0.5) / steps));
      const MatchClass cls = place == nullptr ? MatchClass::outside : place->cls;
      add_step(cls, along(static_cast<double>(i) / steps), along((i + 1.0) / steps), length / steps);
    }
  }

 private:
  void add_step(MatchClass cls, LonLat from, LonLat to, double length_m) {
    summary_.route_m[index_of(cls)] += length_m;
    if (cls != MatchClass::good) {
      if (!open_) summary_.without_good.push_back({from, from, at_m_, 0});
      summary_.without_good.back().to = to;
      summary_.without_good.back().length_m += length_m;
    }
    open_ = cls != MatchClass::good;
    at_m_ += length_m;
  }

  const MatchabilityMap& map_;
  const LocalFrame& frame_;
  MatchabilitySummary& summary_;
  double at_m_ = 0;
  bool open_ = false;
};

}  // namespace

std::size_t MatchabilitySummary::places() const { return std::accumulate(cells.begin(), cells.end(), std::size_t{0}); }

double MatchabilitySummary::share(MatchClass cls) const {
  return places() == 0 ? 0 : static_cast<double>(cells[index_of(cls)]) / static_cast<double>(places());
}

double MatchabilitySummary::route_length_m() const { return std::accumulate(route_m.begin(), route_m.end(), 0.0); }

double MatchabilitySummary::route_share(MatchClass cls) const {
  const double length = route_length_m();
  return length > 0 ? route_m[index_of(cls)] / length : 0;
}

MatchabilitySummary summarize_matchability(const MatchabilityMap& map, const std::vector<LonLat>& route,
                                           const LocalFrame& frame) {
  MatchabilitySummary summary;
  for (const PlaceMatchability& cell : map.cells) {
    if (cell.cls != MatchClass::outside) ++summary.cells[index_of(cell.cls)];
  }
  RouteSampler sampler(map, frame, summary);
  const PlaneRing path = to_plane(frame, route);
  for (std::size_t i = 1; i < path.size(); ++i) sampler.add_leg(path[i - 1], path[i]);
  std::stable_sort(summary.without_good.begin(), summary.without_good.end(),
                   [](const RouteSection& a, const RouteSection& b) { return a.length_m > b.length_m; });
  return summary;
}

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

// A file in memory, so that the real one is written atomically.
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
  register_gdal_drivers();
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
  const GdalHandle raster(
      memory->Create("", grid.columns, grid.rows, static_cast<int>(kBands.size()), GDT_Float32, nullptr));
  need(raster != nullptr);
  const MercatorXY corner = mercator_from_lonlat(grid.lonlat_at(0, 0));
  const double side = grid.step_px * mercator_pixel_m(grid.zoom);
  std::array<double, 6> transform{corner.x_m, side, 0, corner.y_m, 0, -side};
  OGRSpatialReference system;
  need(system.importFromEPSG(3857) == OGRERR_NONE && raster->SetGeoTransform(transform.data()) == CE_None &&
       raster->SetSpatialRef(&system) == CE_None);
  for (std::size_t i = 0; i < kBands.size(); ++i) {
    GDALRasterBand* band = raster->GetRasterBand(static_cast<int>(i) + 1);
    std::vector<float> values = values_of(map, kBands[i]);
    band->SetDescription(kBands[i].name);
    need(band->SetNoDataValue(static_cast<double>(kMatchabilityNodata)) == CE_None &&
         band->RasterIO(GF_Write, 0, 0, grid.columns, grid.rows, values.data(), grid.columns, grid.rows, GDT_Float32, 0,
                        0, nullptr) == CE_None);
  }
  raster->SetMetadataItem("CLASSES", "1 good, 2 weak, 3 poor");
  std::array<const char*, 7> options{"COMPRESS=DEFLATE", "PREDICTOR=3",         "ZLEVEL=6", "INTERLEAVE=BAND",
                                     "NUM_THREADS=1",    "GEOTIFF_VERSION=1.1", nullptr};
  const MemoryFile file;
  GdalHandle written(
      tiff->CreateCopy(file.name().c_str(), raster.get(), 0, const_cast<char**>(options.data()), nullptr, nullptr));
  need(written != nullptr);
  CPLErrorReset();
  written.reset();
  need(CPLGetLastErrorType() < CE_Failure);
  write_file_atomic(path, file.bytes());
}

}  // namespace nadir
