// What a mission asks for in tiles, ground, bytes and seconds, by figures that were measured once.
//
// The required tile set is that of the sectors and of the corridor, which is the route widened in metres of the local
// plane; the bounding box is counted beside it to show the difference.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "package/mission.hpp"

namespace nadir {

// Measured with `nadir cache build`, quality 75, on 145 tiles (zooms 15 to 19) of satellite imagery of a small town
// with fields, on one core of a server of 2023. Forests and towns take up to half more bytes, water and desert far
// less.
struct FormatFigures {
  std::string_view format;
  double bytes_per_tile = 0;
  double cpu_ms_per_tile = 0;  // warping, overviews, encoding, hashing
};
std::optional<FormatFigures> figures_of(std::string_view tile_format);
inline constexpr double kContainerBytesPerTile = 1300;  // sidecar, mask, index, free space of pages; measured as well

struct ZoomPlan {
  int zoom = 0;
  std::uint64_t tiles = 0;      // that a build makes where imagery covers everything: with its margin
  std::uint64_t required = 0;   // of them, those that the mission requires
  std::uint64_t box_tiles = 0;  // of the bounding box of these
  double bytes = 0;
};

struct SectorPlan {
  std::string id;
  SectorClass cls = SectorClass::active;
  double km2 = 0;
};

struct PlanEstimate {
  std::vector<ZoomPlan> zooms;
  std::vector<SectorPlan> sectors;
  double route_km = 0;
  double corridor_km2 = 0;  // route and round ends widened; where it crosses itself counted once
  double needed_km2 = 0;    // sectors and corridor together, what they share counted once
  std::uint64_t tiles = 0;  // of all zooms
  std::uint64_t required = 0;
  double bytes = 0;
  double cpu_seconds = 0;
};

PlanEstimate estimate_plan(const Mission& mission, const FormatFigures& figures);

}  // namespace nadir
