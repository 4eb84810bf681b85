#include "package_build/matchability_survey.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <opencv2/core.hpp>
#include <utility>

#include "base/error.hpp"
#include "base/ordered_work.hpp"
#include "raster/one_opencv_thread.hpp"
#include "imagery/map_window.hpp"

namespace nadir {
namespace {

constexpr int kSamples = 5;        // a cell is needed when one of 5 x 5 places in it is …
constexpr int kRouteSamples = 20;  // of the route in a cell's side
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
      const GlobalPixel corner = pixel_from_lonlat(frame.lonlat_from_enu(x, y), zoom);
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
                      .fix = "take a larger --step-m"});
  }
  grid.columns = static_cast<int>(columns);
  grid.rows = static_cast<int>(rows);
  return grid;
}

// Cells with needed ground in them, and those that a route runs through, however thin its corridor.
std::vector<std::size_t> needed_cells(const MatchabilityGrid& grid, const Region& region, const LocalFrame& frame,
                                      double step_m) {
  std::vector<char> needed(grid.cells(), 0);
  const auto index = [&](int column, int row) {
    return static_cast<std::size_t>(row) * static_cast<std::size_t>(grid.columns) + static_cast<std::size_t>(column);
  };
  const auto asked = [&](double column, double row) {
    const Enu point = frame.enu_from_lonlat(grid.place(column, row));
    return region.contains({point.east_m, point.north_m});
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
    const GlobalPixel pixel = pixel_from_lonlat(frame.lonlat_from_enu(point.east_m, point.north_m), grid.zoom);
    const double column = std::floor(pixel.x / grid.step_px) - static_cast<double>(grid.first_column);
    const double row = std::floor(pixel.y / grid.step_px) - static_cast<double>(grid.first_row);
    if (column < 0 || row < 0 || column >= grid.columns || row >= grid.rows) return;
    needed[index(static_cast<int>(column), static_cast<int>(row))] = 1;
  };
  for (const Corridor& corridor : region.corridors) {
    for (std::size_t i = 1; i < corridor.path.size(); ++i) {
      const PlanePoint a = corridor.path[i - 1], b = corridor.path[i];
      const double length_m = std::hypot(b.east_m - a.east_m, b.north_m - a.north_m);
      const int steps = std::max(1, static_cast<int>(std::ceil(length_m / step_m * kRouteSamples)));
      for (int k = 0; k <= steps; ++k) {
        const double share = static_cast<double>(k) / steps;
        touch({a.east_m + share * (b.east_m - a.east_m), a.north_m + share * (b.north_m - a.north_m)});
      }
    }
  }
  std::vector<std::size_t> cells;
  for (std::size_t i = 0; i < needed.size(); ++i) {
    if (needed[i] != 0) cells.push_back(i);
  }
  return cells;
}

LonLat middle_of(const MatchabilityGrid& grid, std::size_t cell) {
  const auto columns = static_cast<std::size_t>(grid.columns);
  return grid.place(static_cast<double>(cell % columns) + 0.5, static_cast<double>(cell / columns) + 0.5);
}

PlaneBox box_around(const LocalFrame& frame, LonLat place, double reach_m) {
  const Enu middle = frame.enu_from_lonlat(place);
  return {middle.east_m - reach_m, middle.north_m - reach_m, middle.east_m + reach_m, middle.north_m + reach_m};
}

// The median over cells that are spread evenly over the grid.
MatchabilityOptions against_typical_texture(const TileSource& tiles, const LocalFrame& frame,
                                            const MatchabilityGrid& grid, const std::vector<std::size_t>& needed,
                                            MatchabilityOptions options) {
  MapWindowReader reader(tiles, kCachedTiles);
  std::vector<double> textures;
  const std::size_t stride = std::max<std::size_t>(1, needed.size() / kTextureSamples);
  for (std::size_t i = 0; i < needed.size(); i += stride) {
    const PlaneBox box = box_around(frame, middle_of(grid, needed[i]), options.footprint_m / 2);
    const MapWindow window = reader.read(frame, box, options.gsd_m, Colour::grey);
    if (cv::countNonZero(window.mask) == 0) continue;
    textures.push_back(MatchabilityProbe::texture_of(window.image, window.mask));
  }
  if (textures.empty()) return options;
  const auto median = textures.begin() + static_cast<std::ptrdiff_t>(textures.size() / 2);
  std::nth_element(textures.begin(), median, textures.end());
  options.typical_texture = *median;
  return options;
}

}  // namespace

LonLat MatchabilityGrid::place(double column, double row) const {
  return lonlat_from_pixel(
      {(static_cast<double>(first_column) + column) * step_px, (static_cast<double>(first_row) + row) * step_px}, zoom);
}

const PlaceMatchability* MatchabilityMap::at(LonLat place) const {
  const GlobalPixel pixel = pixel_from_lonlat(place, grid.zoom);
  const auto column = static_cast<std::int64_t>(std::floor(pixel.x / grid.step_px)) - grid.first_column;
  const auto row = static_cast<std::int64_t>(std::floor(pixel.y / grid.step_px)) - grid.first_row;
  if (column < 0 || row < 0 || column >= grid.columns || row >= grid.rows) return nullptr;
  const PlaceMatchability& cell =
      cells[static_cast<std::size_t>(row) * static_cast<std::size_t>(grid.columns) + static_cast<std::size_t>(column)];
  return cell.cls == MatchClass::outside ? nullptr : &cell;
}

MatchabilityMap survey_matchability(const TileSource& tiles, const Region& region, const LocalFrame& frame, int zoom,
                                    double step_m, const MatchabilityOptions& options, int threads,
                                    Progress& progress) {
  MatchabilityMap map;
  map.grid = grid_over(region, frame, zoom, step_m);
  map.cells.resize(map.grid.cells());
  const std::vector<std::size_t> needed = needed_cells(map.grid, region, frame, step_m);
  const MatchabilityProbe probe(against_typical_texture(tiles, frame, map.grid, needed, options));
  const OneOpenCvThread one_opencv_thread;
  const auto columns = static_cast<std::uint64_t>(map.grid.columns);
  progress.begin("matchability", needed.size(), "places");
  const auto make_worker = [&]() -> std::function<PlaceMatchability(std::size_t)> {
    auto reader = std::make_shared<MapWindowReader>(tiles, kCachedTiles);
    return [&, reader](std::size_t item) {
      const PlaneBox box = box_around(frame, middle_of(map.grid, needed[item]), probe.reach_m());
      const MapWindow window = reader->read(frame, box, options.gsd_m, Colour::grey);
      // Numbered by where it lies in the world, so that a place wears the same noise whatever is asked around it.
      const std::uint64_t column = needed[item] % columns, row = needed[item] / columns;
      const std::uint64_t number = (static_cast<std::uint64_t>(map.grid.first_row) + row) << 32U |
                                   (static_cast<std::uint64_t>(map.grid.first_column) + column);
      return probe.probe(window, number);
    };
  };
  work_in_order<PlaceMatchability>(needed.size(), threads, make_worker,
                                   [&](std::size_t item, const PlaceMatchability& place) {
                                     map.cells[needed[item]] = place;
                                     progress.advance();
                                     return true;
                                   });
  progress.end();
  return map;
}

}  // namespace nadir
