// A recorded session as CSV files and as GeoJSON.
#pragma once

#include <filesystem>

#include "commands/recorder/export/flight_tables.hpp"

namespace nadir {

// estimates.csv, anchors.csv and events.csv (RFC 4180) in a folder; places as lat_deg and lon_deg.
void export_csv(const FlightTables& tables, const std::filesystem::path& folder);

// One FeatureCollection (RFC 7946): the track as a line, estimates and anchors with places as points; `kind` tells them
// apart.
std::string geojson_of(const FlightTables& tables);

}  // namespace nadir
