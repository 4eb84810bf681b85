// The tiles of a COG, with the sidecars beside it. Inside this folder only: tile_container.hpp.
#pragma once

#include "imagery/cog_reader.hpp"
#include "package/tile_container.hpp"

namespace nadir {

std::unique_ptr<TileContainer> open_cog_container(const std::filesystem::path& path);

}  // namespace nadir
