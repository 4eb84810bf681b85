// What a file of another program states of a mission, and the mission that follows from it.
//
// Ground stations and GIS programs hold parts of a mission: a route with heights, areas, a take-off point. None holds
// dates, zooms or freshness. A Drawing is what a file does state; the rest comes from a base: the mission that Nadir
// wrote into the file when it exported it, a mission file that the user names, or usual values, which the new mission
// file marks for review. Geometry always comes from the file's own geometry, also when the file carries a mission:
// what was moved in the other program stays moved.
//
// Heights are counted from the ground, from the take-off point or from sea level. A frame is kept, never converted: a
// route that mixes them, as missions with a landing do, keeps one for each point. Other frames are refused by name.
#pragma once

#include <filesystem>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "base/error.hpp"
#include "package/mission.hpp"

namespace nadir {

struct DrawnLine {
  std::string name;
  std::vector<LonLat> points;
  std::vector<double> heights_m;      // one for each point, or none
  std::optional<HeightFrame> frame;   // of the heights; none where the file does not say
  std::vector<HeightFrame> frames{};  // one for each height where they differ; otherwise none
};

enum class AreaKind { unstated, sector, no_fly };

struct DrawnArea {
  std::string name;
  AreaKind kind = AreaKind::unstated;
  std::vector<LonLat> polygon;  // without the closing point; empty for a circle
  LonLat centre;
  double radius_m = 0;
};

struct MissionDrawing {
  std::vector<DrawnLine> lines;
  std::vector<DrawnArea> areas;
  std::optional<LonLat> takeoff;
  std::optional<double> takeoff_height_m;   // above sea level
  std::optional<std::string> mission_text;  // the mission that was exported into this file, as YAML
  bool holds_areas = true;                  // false: this kind of file has routes alone; areas come from the base
  Findings notes;                           // "import.left_out": what a mission does not hold
};

// Reads KML, KMZ, GeoJSON, GeoPackage and the other vector formats of GDAL, QGroundControl's .plan, and MAVLink's
// waypoints (QGC WPL 110), told apart by content. Throws Error or UsageError for a file that is none of these, damaged,
// too large or hostile. latitude_first: the file has its coordinates the wrong way round.
MissionDrawing read_mission_drawing(const std::filesystem::path& path, bool latitude_first = false);

struct MissionImportOptions {
  std::optional<std::string> id;     // of mission and series; needed without a base
  std::optional<std::string> route;  // name of the line, where there are several
  SectorClass sector_class = SectorClass::active;
  std::optional<double> half_width_m, agl_m, ground_m, buffer_m;
  std::optional<HeightFrame> height_frame;  // where the file does not say
  std::set<std::string> no_fly;             // names of areas
  std::optional<Mission> base;              // before what the file carries
  UtcTime today;
};

struct ImportedMission {
  std::string yaml;
  MissionReading reading;  // of the text: with errors it must not be used
  Findings notes;
};

// Usual values, created on that day; without an id, a take-off point and ground.
Mission usual_mission(UtcTime today);

// Throws UsageError where it is unclear what is meant: several lines, no id, coordinates that lie the wrong way round.
ImportedMission mission_from_drawing(const MissionDrawing& drawing, const MissionImportOptions& options,
                                     const std::string& where);

// Whether points that lie far from the reference lie near it with longitude and latitude exchanged.
bool looks_swapped(const std::vector<LonLat>& points, LonLat reference);

}  // namespace nadir
