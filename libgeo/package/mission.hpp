// What a mission needs from its map: where it flies, how fine and how fresh the imagery must be, and for whom the
// package is made. Written by people as YAML (schema nadir.mission/1, schemas/mission.schema.json).
//
// Units as in the file: degrees (longitude, latitude, WGS84), metres, seconds, days, megabytes (10^6 bytes).
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "base/error.hpp"
#include "base/time.hpp"
#include "geodesy/lon_lat.hpp"
#include "geodesy/region.hpp"
#include "imagery/tile_source.hpp"

namespace nadir {

inline constexpr std::string_view kMissionSchema = "nadir.mission/1";
inline constexpr std::string_view kAnyAirframe = "any";

// How fast the ground changes; determines how old its imagery may be.
enum class SectorClass { stable, active };
std::string_view name_of(SectorClass cls);

struct Sector {
  std::string id;
  SectorClass cls = SectorClass::active;
  std::vector<LonLat> polygon;  // without the closing point that the file repeats
  double buffer_m = 0;          // everything within this distance of the polygon belongs to the sector

  bool operator==(const Sector&) const = default;
};

struct FreshnessDays {
  int stable = 0;
  int active = 0;

  int of(SectorClass cls) const { return cls == SectorClass::stable ? stable : active; }
  bool operator==(const FreshnessDays&) const = default;
};

// What the heights of a route are counted from.
enum class HeightFrame { above_ground, above_takeoff, above_sea_level };
std::string_view name_of(HeightFrame frame);
struct Route {
  double corridor_half_width_m = 0;
  double agl_m = 0;            // planned height above ground, where heights_m says nothing else
  std::vector<LonLat> points;  // none: an area alone
  HeightFrame height_frame = HeightFrame::above_ground;
  std::vector<double> heights_m;  // one for each point, or none
  // One for each point where they differ; otherwise none. Between two points of different ones the height above ground
  // goes linearly from one to the other, each over the ground of the place.
  std::vector<HeightFrame> height_frames{};

  HeightFrame frame_at(std::size_t point) const { return height_frames.empty() ? height_frame : height_frames[point]; }
  // Every height, and the planned one without heights, is counted from the ground.
  bool all_above_ground() const {
    return heights_m.empty() || (height_frames.empty() && height_frame == HeightFrame::above_ground);
  }

  bool operator==(const Route&) const = default;
};
std::string height_frames_of(const Route& route);  // for people: "above_takeoff", "above_takeoff and above_sea_level"

// Where the aircraft must not be. The map does not need it; people who plan do.
struct NoFlyArea {
  std::string id;
  std::vector<LonLat> polygon;  // without the closing point; empty for a circle
  LonLat centre;
  double radius_m = 0;  // of the circle

  bool operator==(const NoFlyArea&) const = default;
};

// Ground without an elevation model is flat at one height.
struct Terrain {
  bool flat = true;     // false: the package holds terrain/dem.tif
  double height_m = 0;  // of the flat ground; with an elevation model only of the local plane of coordinates

  bool operator==(const Terrain&) const = default;
};

// Which positions may be used. Optional in the file, as a whole and each value.
//
// The protection level of a position is the radius that holds the aircraft with all but the risk. Within the alert
// limit the position is usable; otherwise the operator knows within the time to alert.
struct IntegrityRequirement {
  double risk = 1e-5;  // per look at the map
  double alert_limit_m = 100;
  double time_to_alert_s = 3;

  bool operator==(const IntegrityRequirement&) const = default;
};

inline constexpr double kMinIntegrityRisk = 1e-9, kMaxIntegrityRisk = 1e-2;
inline constexpr double kMinAlertLimit_m = 1, kMaxAlertLimit_m = 10'000;
inline constexpr double kMinTimeToAlert_s = 0.5, kMaxTimeToAlert_s = 60;

struct Mission {
  std::string id;
  std::string series;         // packages of one series replace each other, by sequence
  std::int64_t sequence = 0;  // at least 1
  UtcTime created;
  UtcTime expires;
  LonLat takeoff;
  Terrain terrain;
  ZoomRange zoom;
  double min_resolution_m = 0;  // the coarsest acceptable ground sample distance
  std::int64_t budget_mb = 0;
  FreshnessDays freshness_days;
  std::vector<std::string> airframes;  // kAnyAirframe: every airframe
  std::vector<Sector> sectors;
  Route route;
  std::vector<NoFlyArea> no_fly;
  IntegrityRequirement integrity;

  bool allows(std::string_view airframe) const;
  bool operator==(const Mission&) const = default;
};

// Everything that is wrong, as findings "mission.schema" with file, line and column. `mission` is there exactly when
// nothing is wrong. A file that cannot be read throws Error.
struct MissionReading {
  std::optional<Mission> mission;
  Findings findings;
};
MissionReading check_mission(const std::filesystem::path& path);
MissionReading parse_mission(std::string_view yaml, std::string_view name);

// The mission, or UsageError with the first finding.
Mission read_mission(const std::filesystem::path& path);

// Sectors and corridor in the plane of `frame`, which is usually mission_frame().
LocalFrame mission_frame(const Mission& mission);  // origin: the take-off point
Region required_region(const Mission& mission, const LocalFrame& frame);
Region region_of(const Sector& sector, const LocalFrame& frame);  // with its buffer
Region corridor_of(const Route& route, const LocalFrame& frame);  // without rings; empty for an area alone

// Planned height above the ground at a point of the route, where the ground is at these heights above sea level.
double height_above_ground_m(const Mission& mission, std::size_t point, double ground_m, double takeoff_ground_m);

}  // namespace nadir
