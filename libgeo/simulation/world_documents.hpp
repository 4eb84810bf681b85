// The papers of a made-up world: STAC items, a mission over it, a camera, and its place on Earth.
#pragma once

#include "simulation/landscape.hpp"
#include "simulation/picture_writer.hpp"
#include "simulation/world.hpp"

namespace nadir {

Placement world_placement(double size_m, double gsd_m);

// Radius that holds 90 % of the map's misplacements.
double map_ce90_m(const Landscape& land);

void write_world_documents(const Landscape& land, const WorldOptions& options, const Placement& placement,
                           const std::filesystem::path& folder);

}  // namespace nadir
