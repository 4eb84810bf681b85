// Missions as autopilots fly them: QGroundControl's .plan (JSON) and MAVLink's waypoints (QGC WPL 110, tab-separated).
//
// An item is a MAV_CMD with a MAV_FRAME. Commands that fly to a place (waypoint, take-off, landing, loiter, spline)
// make the route; others, such as camera triggers, are counted and left out. Frames: 0 and 5 above sea level, 3 and 6
// above the take-off point, 10 and 11 above ground; a place in any other frame is refused by name. They may be mixed,
// as by a survey above ground that ends with a landing: each point keeps its own. A survey or a corridor scan is flown
// along its transects, and its polygon is a sector. Geofences that exclude are no-fly areas; those that include, rally
// points and jumps are left out, by name.
//
// Sources: QGroundControl's "Plan File Format" (developer guide), MAVLink's "File Formats", ArduPilot's fence commands
// 5001 to 5004.
#pragma once

#include <string>
#include <string_view>

#include "mission_formats/mission_drawing.hpp"

namespace nadir {

bool is_waypoint_file(std::string_view text);
bool is_plan(std::string_view text);  // JSON with "fileType": "Plan", or an older QGroundControl mission

// Throw Error or UsageError with the item or line.
MissionDrawing read_plan(std::string_view text, const std::string& where);
MissionDrawing read_waypoints(std::string_view text, const std::string& where);

// UsageError for a mission without a route.
std::string mission_as_plan(const Mission& mission);
std::string mission_as_waypoints(const Mission& mission);

}  // namespace nadir
