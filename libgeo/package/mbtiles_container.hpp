// The rows of an MBTiles file. Inside this folder only: tile_container.hpp.
#pragma once

#include "imagery/mbtiles.hpp"
#include "package/tile_container.hpp"

namespace nadir {

std::unique_ptr<TileContainer> open_mbtiles_container(const std::filesystem::path& path);

// The table "metadata" of a database, empty without one.
std::map<std::string, std::string> metadata_in(const SqliteDatabase& database);

}  // namespace nadir
