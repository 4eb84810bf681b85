// A recorded session through GDAL's vector drivers: one file, a layer per table and one with the track.
#pragma once

#include <filesystem>
#include <string>

#include "commands/recorder/export/flight_tables.hpp"

namespace nadir {

// driver: "KML", "GPKG" or "Parquet". Throws Error where this GDAL does not have it. Parquet files hold one table: the
// estimates.
void export_gdal(const FlightTables& tables, const std::string& driver, const std::filesystem::path& path);

}  // namespace nadir
