// A mission written for another program. Reading: mission_drawing.hpp.
#pragma once

#include <array>
#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "mission_formats/mission_drawing.hpp"

namespace nadir {

enum class MissionFormat { kml, kmz, geojson, gpkg, plan, waypoints };
inline constexpr std::array kMissionFormats{MissionFormat::kml,  MissionFormat::kmz,  MissionFormat::geojson,
                                            MissionFormat::gpkg, MissionFormat::plan, MissionFormat::waypoints};
std::string_view name_of(MissionFormat format);
std::optional<MissionFormat> mission_format_of(std::string_view name);  // of name_of(), which is the usual ending

// Returns what the format does not hold, for the user. Throws UsageError for what it would falsify.
std::vector<std::string> write_mission_as(const Mission& mission, MissionFormat format,
                                          const std::filesystem::path& path);

}  // namespace nadir
