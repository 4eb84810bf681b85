// Missions as drawings of GIS programs: KML and KMZ (Google Earth), GeoJSON, GeoPackage (QGIS).
//
// All of them hold the same features: the route as a line, sectors and no-fly areas as polygons, the take-off as a
// point. Attributes beside each: "nadir_kind" (route, sector, no_fly, takeoff), "class", "buffer_m", "height_frame",
// and for a circle, which is drawn as a polygon, its middle and radius. The take-off carries "nadir_mission", the whole
// mission as YAML, for what a drawing does not hold. Coordinates are written so that they read back to the last bit.
#pragma once

#include <filesystem>
#include <string>
#include <string_view>

#include "base/bytes.hpp"
#include "mission_formats/mission_drawing.hpp"

namespace nadir {

MissionDrawing read_gis_drawing(const std::filesystem::path& path, bool latitude_first);
// Of KML in memory; refuses document types and entities.
MissionDrawing read_kml_drawing(std::string_view text, const std::string& where, bool latitude_first);
// The first KML document in an archive, at most kMaxDrawing_bytes of it.
std::string kml_of_archive(const std::filesystem::path& path);

inline constexpr std::uint64_t kMaxDrawing_bytes = std::uint64_t{64} << 20;

std::string mission_as_kml(const Mission& mission);  // UsageError for heights that KML cannot state
Bytes mission_as_kmz(const Mission& mission);
std::string mission_as_geojson(const Mission& mission);
void write_mission_geopackage(const Mission& mission, const std::filesystem::path& path);

}  // namespace nadir
