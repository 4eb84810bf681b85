// Makes a whole world on disk: ground.tif (the day of the flight), map.tif (the satellite's picture, months earlier),
// dem.tif, their STAC items, and a mission and a camera that fit. docs/simulate-world.md.
#pragma once

#include <cstdint>
#include <filesystem>

#include "base/progress.hpp"
#include "simulation/landscape.hpp"
#include "simulation/geotiff_writer.hpp"

namespace nadir {

struct WorldOptions {
  std::uint64_t seed = 1;
  double size_km = 2;
  double gsd_m = 0.5;
};

struct WorldReport {
  int side_px = 0;
  std::size_t parcels = 0;
  std::size_t buildings = 0;
  std::size_t trees = 0;
  double relief_m = 0;    // highest minus lowest ground
  double map_ce90_m = 0;  // of the map's misplacement
};

// Fills `folder`, which must exist. The same options give the same bytes.
WorldReport make_world(const WorldOptions& options, const std::filesystem::path& folder, Progress& progress);

// The papers of a made-up world: STAC items, a mission over it, a camera, and its place on Earth.

RasterPlacement world_placement(double size_m, double gsd_m);

// Radius that holds 90 % of the map's misplacements.
double map_ce90_m(const Landscape& land);

void write_world_documents(const Landscape& land, const WorldOptions& options, const RasterPlacement& placement,
                           const std::filesystem::path& folder);

}  // namespace nadir
