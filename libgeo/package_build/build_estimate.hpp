// How large a package will be and how long its building takes, before it is built: what a mission asks for in tiles,
// ground, bytes and seconds.
//
// Without imagery, by figures that were measured once for each format. With imagery, squares of tiles are made as the
// build makes them, all of them or an even sample, and thrown away: within 10 % of the package for imagery of any kind.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "base/progress.hpp"
#include "package/mission.hpp"
#include "package_build/tile_set_builder.hpp"
#include "raster/imagery_input.hpp"

namespace nadir {

// Measured with `nadir cache build`, quality 75, on 145 tiles (zooms 15 to 19) of satellite imagery of a small town
// with fields, on one core of a server of 2023. Forests and towns take up to half more bytes, water and desert far
// less.
struct TileFormatFigures {
  std::string_view format;
  double bytes_per_tile = 0;
  double cpu_ms_per_tile = 0;  // warping, overviews, encoding, hashing
};
std::optional<TileFormatFigures> tile_format_figures(std::string_view format);  // jpeg, webp, png

struct ZoomEstimate {
  int zoom = 0;
  std::uint64_t tiles = 0;      // that a build makes, with its margin; without imagery: where that covers everything
  std::uint64_t required = 0;   // tiles that the mission requires
  std::uint64_t box_tiles = 0;  // of the bounding box of these
  double bytes = 0;
};

struct SectorEstimate {
  std::string id;
  SectorClass cls = SectorClass::active;
  double km2 = 0;  // without its buffer
};

struct BuildEstimate {
  std::vector<ZoomEstimate> zooms;
  std::vector<SectorEstimate> sectors;
  double route_km = 0;
  double corridor_km2 = 0;  // route and round ends widened; where it crosses itself counted once
  double needed_km2 = 0;    // sectors and corridor together, what they share counted once
  std::uint64_t tiles = 0;  // of all zooms
  std::uint64_t required = 0;
  double bytes = 0;
  double cpu_seconds = 0;
  std::size_t squares = 0, sampled_squares = 0;  // of 8 x 8 tiles; with imagery
};

BuildEstimate estimate_build(const Mission& mission, const TileFormatFigures& figures);

// figures: of the time alone.
BuildEstimate estimate_build(const Mission& mission, const TileFormatFigures& figures,
                             std::span<const ImageryInput> inputs, const TileSetOptions& options, Progress& progress);

// "budget.exceeded", a warning.
Findings check_estimate(const Mission& mission, const BuildEstimate& estimate);

}  // namespace nadir
