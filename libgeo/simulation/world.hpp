// Makes a complete world on disk: ground.tif (the day of the flight), map.tif (a satellite image, months earlier),
// dem.tif, their STAC items, roads, water, woods and buildings (vectors.geojson), and a matching mission and camera.
// docs/commands/simulate-world.md.
#pragma once

#include <cstdint>
#include <filesystem>

#include "base/progress.hpp"
#include "simulation/geotiff_writer.hpp"
#include "simulation/landscape.hpp"

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

// The position of a synthetic world on Earth.
RasterPlacement world_placement(double size_m, double gsd_m);

// Circular error of the map: 90 % of its misplacements are smaller.
double map_ce90_m(const Landscape& land);

// STAC items, vectors, a mission over the world, and a camera.
void write_world_documents(const Landscape& land, const WorldOptions& options, const RasterPlacement& placement,
                           const std::filesystem::path& folder);

}  // namespace nadir
