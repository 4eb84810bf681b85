// The place index of a package that is updated, for the new tiles: squares of the same sizes and resolution,
// overlapping as much. The old one itself must not survive, because its descriptors are those of the old pictures.
#pragma once

#include <filesystem>

#include "base/progress.hpp"
#include "package_build/tile_set_writer.hpp"
#include "vision/place_index.hpp"

namespace nadir {

// How the old index was made. Throws UsageError when there is none, Error when it is not what was signed.
PlaceTable old_place_table(const std::filesystem::path& package, const Manifest& manifest);

// tiles: the new file, which is closed. origin: of the new mission's plane. Throws as build_place_index().
PlaceIndex remake_place_index(const PlaceTable& old, const std::filesystem::path& tiles, const TileSet& set,
                              LonLat origin, int threads, Progress& progress);

}  // namespace nadir
