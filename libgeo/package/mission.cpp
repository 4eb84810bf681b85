// Each part of mission.yaml is read by itself, so that one run shows everything that is wrong in the file.
#include "package/mission.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <set>

#include "base/error.hpp"
#include "base/files.hpp"
#include "base/yaml.hpp"
#include "geodesy/web_mercator.hpp"

namespace nadir {
namespace {

// Bounds that no sensible mission exceeds; they keep later arithmetic (areas, tile counts) far from its limits.
constexpr std::size_t kMaxIdLength = 64;
constexpr std::size_t kMaxSectors = 256;
constexpr std::size_t kMaxPoints = 4096;
constexpr double kMinSectorArea_m2 = 100;
constexpr double kMaxDistanceFromTakeoff_m = 200'000;
constexpr double kMaxHalfWidth_m = 10'000;
constexpr double kMaxAgl_m = 10'000;
constexpr double kMaxFlightHeight_m = 20'000;
constexpr std::int64_t kMaxFreshness_days = 36'500;
constexpr std::int64_t kMaxBudget_mb = 1'000'000;

// Turns what a part throws into a finding, so that the next part is read.
class PartReader {
 public:
  explicit PartReader(Findings& findings) : findings_(findings) {}

  void attempt(const std::function<void()>& read) {
    try {
      read();
    } catch (const UsageError& error) {
      const ErrorText& text = error.text();
      findings_.add({.code = "mission.schema",
                     .where = text.where,
                     .expected = text.expected,
                     .found = text.found.empty() ? text.what : text.found,
                     .fix = text.fix});
    }
  }

 private:
  Findings& findings_;
};

[[noreturn]] void refuse(const YamlNode& node, std::string expected, std::string found, std::string fix = {}) {
  throw UsageError({.what = "a value is not usable",
                    .where = node.where(),
                    .expected = std::move(expected),
                    .found = std::move(found),
                    .fix = std::move(fix)});
}

// Ids become parts of file names, URLs and log lines.
std::string read_id(const YamlNode& node) {
  std::string id = node.text();
  const auto allowed = [](char c) {
    return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '-' || c == '_' ||
           c == '.';
  };
  const bool alphanumeric_start = !id.empty() && id[0] != '-' && id[0] != '_' && id[0] != '.';
  if (!alphanumeric_start || id.size() > kMaxIdLength || !std::all_of(id.begin(), id.end(), allowed)) {
    node.reject("1 to 64 letters, digits, '-', '_' or '.', beginning with a letter or digit");
  }
  return id;
}

UtcTime read_time(const YamlNode& node) {
  const auto time = parse_utc(node.text());
  if (!time) node.reject("a time like 2024-10-30T00:00:00Z or a date like 2024-10-30");
  return *time;
}

double number_between(const YamlNode& node, double low, double high, std::string_view unit) {
  const double value = node.number();
  if (!(value >= low && value <= high)) node.reject(fmt::format("{} to {} {}", low, high, unit));
  return value;
}

double positive_up_to(const YamlNode& node, double high, std::string_view unit) {
  const double value = node.number();
  if (!(value > 0 && value <= high)) node.reject(fmt::format("above 0 and at most {} {}", high, unit));
  return value;
}

std::int64_t integer_between(const YamlNode& node, std::int64_t low, std::int64_t high) {
  const std::int64_t value = node.integer();
  if (value < low || value > high) node.reject(fmt::format("a whole number from {} to {}", low, high));
  return value;
}

LonLat checked_place(const YamlNode& lon, const YamlNode& lat) {
  return {number_between(lon, -180, 180, "degrees of longitude"), number_between(lat, -85, 85, "degrees of latitude")};
}

LonLat read_point(const YamlNode& node) {
  const auto pair = node.items();
  if (pair.size() != 2) node.reject("a point: [longitude, latitude]");
  return checked_place(pair[0], pair[1]);
}

std::vector<LonLat> read_points(const YamlNode& node, std::size_t least) {
  const auto items = node.items();
  if (items.size() < least || items.size() > kMaxPoints) {
    refuse(node, fmt::format("{} to {} points", least, kMaxPoints), fmt::format("{} points", items.size()));
  }
  std::vector<LonLat> points;
  points.reserve(items.size());
  for (const YamlNode& item : items) points.push_back(read_point(item));
  return points;
}

void check_near(const YamlNode& node, const std::vector<LonLat>& points, const std::optional<LonLat>& takeoff) {
  if (!takeoff) return;
  const LocalFrame frame(*takeoff);
  for (std::size_t i = 0; i < points.size(); ++i) {
    const double away_m = distance_m(frame.plane_from_lonlat(points[i]), {});
    if (away_m > kMaxDistanceFromTakeoff_m) {
      refuse(node, fmt::format("points within {:.0f} km of take-off", kMaxDistanceFromTakeoff_m / 1000),
             fmt::format("point {} is {:.0f} km away", i + 1, away_m / 1000),
             "coordinates are longitude first, then latitude");
    }
  }
}

std::vector<LonLat> read_polygon(const YamlNode& node, const std::optional<LonLat>& takeoff) {
  std::vector<LonLat> ring = read_points(node, 4);
  if (!(ring.front() == ring.back())) {
    refuse(node, "a closed ring: the last point repeats the first",
           fmt::format("first [{}, {}], last [{}, {}]", ring.front().lon_deg, ring.front().lat_deg, ring.back().lon_deg,
                       ring.back().lat_deg));
  }
  ring.pop_back();
  check_near(node, ring, takeoff);
  const PlaneRing plane = to_plane(LocalFrame(ring.front()), ring);
  if (self_intersects(plane)) refuse(node, "a ring that does not cross itself", "edges that cross");
  const double area = std::abs(area_m2(plane));
  if (!(area >= kMinSectorArea_m2)) {
    refuse(node, fmt::format("an area of at least {} m²", kMinSectorArea_m2), fmt::format("{:.1f} m²", area));
  }
  return ring;
}

Sector read_sector(const YamlNode& node, const std::optional<LonLat>& takeoff) {
  node.allow_only({"id", "class", "polygon", "buffer_m"});
  Sector sector;
  sector.id = read_id(node.required("id"));
  const YamlNode cls = node.required("class");
  if (cls.text() == "stable") {
    sector.cls = SectorClass::stable;
  } else if (cls.text() != "active") {
    cls.reject("\"stable\" or \"active\"");
  }
  sector.polygon = read_polygon(node.required("polygon"), takeoff);
  if (const auto buffer = node.optional("buffer_m")) {
    sector.buffer_m = number_between(*buffer, 0, kMaxHalfWidth_m, "metres");
  }
  return sector;
}

NoFlyArea read_no_fly_area(const YamlNode& node, const std::optional<LonLat>& takeoff) {
  node.allow_only({"id", "polygon", "circle"});
  NoFlyArea area;
  area.id = read_id(node.required("id"));
  const auto polygon = node.optional("polygon"), circle = node.optional("circle");
  if (polygon.has_value() == circle.has_value()) refuse(node, "a polygon or a circle", polygon ? "both" : "neither");
  if (polygon) {
    area.polygon = read_polygon(*polygon, takeoff);
    return area;
  }
  circle->allow_only({"lon_deg", "lat_deg", "radius_m"});
  area.centre = checked_place(circle->required("lon_deg"), circle->required("lat_deg"));
  area.radius_m = positive_up_to(circle->required("radius_m"), kMaxDistanceFromTakeoff_m, "metres");
  check_near(*circle, {area.centre}, takeoff);
  return area;
}

void read_no_fly(const YamlNode& list, const std::optional<LonLat>& takeoff, PartReader& reader, Mission& mission) {
  const auto items = list.items();
  if (items.size() > kMaxSectors) {
    refuse(list, fmt::format("at most {} no-fly areas", kMaxSectors), fmt::format("{}", items.size()));
  }
  std::set<std::string> ids;
  for (const YamlNode& item : items) {
    reader.attempt([&] {
      NoFlyArea area = read_no_fly_area(item, takeoff);
      if (!ids.insert(area.id).second) item.required("id").reject("an id that no other no-fly area has");
      mission.no_fly.push_back(std::move(area));
    });
  }
}

void read_sectors(const YamlNode& list, const std::optional<LonLat>& takeoff, PartReader& reader, Mission& mission) {
  const auto items = list.items();
  if (items.size() > kMaxSectors) {
    refuse(list, fmt::format("at most {} sectors", kMaxSectors), fmt::format("{}", items.size()));
  }
  std::set<std::string> ids;
  for (const YamlNode& item : items) {
    reader.attempt([&] {
      Sector sector = read_sector(item, takeoff);
      if (!ids.insert(sector.id).second) item.required("id").reject("an id that no other sector has");
      mission.sectors.push_back(std::move(sector));
    });
  }
}

constexpr std::array kHeightFrames{HeightFrame::above_ground, HeightFrame::above_takeoff, HeightFrame::above_sea_level};

HeightFrame read_frame(const YamlNode& node) {
  const auto* found = std::find_if(kHeightFrames.begin(), kHeightFrames.end(),
                                   [&](HeightFrame one) { return name_of(one) == node.text(); });
  if (found == kHeightFrames.end()) node.reject("\"above_ground\", \"above_takeoff\" or \"above_sea_level\"");
  return *found;
}

void read_frames(const YamlNode& list, Route& route) {
  const auto frames = list.items();
  if (frames.size() != route.points.size()) {
    refuse(list, fmt::format("one frame for each of the {} points", route.points.size()),
           fmt::format("{} frames", frames.size()));
  }
  for (const YamlNode& node : frames) route.height_frames.push_back(read_frame(node));
  if (route.height_frames.empty()) return;
  // Of one kind: the same mission as with "frame".
  route.height_frame = route.height_frames.front();
  const bool same = std::all_of(route.height_frames.begin(), route.height_frames.end(),
                                [&](HeightFrame one) { return one == route.height_frame; });
  if (same) route.height_frames.clear();
}

void read_heights(const YamlNode& node, Route& route) {
  node.allow_only({"frame", "frames", "m"});
  const auto frames = node.optional("frames");
  if (!frames) {
    route.height_frame = read_frame(node.required("frame"));
  } else if (node.optional("frame")) {
    frames->reject("one frame for all heights (\"frame\"), or one for each (\"frames\"), not both");
  } else {
    read_frames(*frames, route);
  }
  const YamlNode list = node.required("m");
  const auto heights = list.items();
  if (heights.size() != route.points.size()) {
    refuse(list, fmt::format("one height for each of the {} points", route.points.size()),
           fmt::format("{} heights", heights.size()));
  }
  for (const YamlNode& height : heights) {
    route.heights_m.push_back(number_between(height, -500, kMaxFlightHeight_m, "metres"));
  }
}

Route read_route(const YamlNode& node, const std::optional<LonLat>& takeoff) {
  node.allow_only({"corridor_half_width_m", "agl_m", "points", "heights"});
  Route route;
  route.corridor_half_width_m = positive_up_to(node.required("corridor_half_width_m"), kMaxHalfWidth_m, "metres");
  route.agl_m = positive_up_to(node.required("agl_m"), kMaxAgl_m, "metres");
  const YamlNode points = node.required("points");
  route.points = read_points(points, 0);
  if (route.points.size() == 1) refuse(points, "two points or more, or none for an area alone", "1 point");
  check_near(points, route.points, takeoff);
  for (std::size_t i = 1; i < route.points.size(); ++i) {
    if (route.points[i] == route.points[i - 1]) {
      refuse(points, "points that differ from the one before", fmt::format("point {} repeats point {}", i + 1, i));
    }
  }
  if (const auto heights = node.optional("heights")) read_heights(*heights, route);
  return route;
}

Terrain read_terrain(const YamlNode& node) {
  node.allow_only({"mode", "height_m"});
  Terrain terrain;
  const YamlNode mode = node.required("mode");
  terrain.flat = mode.text() == "flat";
  if (!terrain.flat && mode.text() != "dem") mode.reject("\"flat\" or \"dem\"");
  if (const auto height = node.optional("height_m")) terrain.height_m = number_between(*height, -500, 9000, "metres");
  return terrain;
}

ZoomRange read_zoom(const YamlNode& node) {
  node.allow_only({"min", "max"});
  ZoomRange zoom;
  zoom.min = static_cast<int>(integer_between(node.required("min"), 0, kMaxZoom));
  zoom.max = static_cast<int>(integer_between(node.required("max"), 0, kMaxZoom));
  if (zoom.min > zoom.max) refuse(node, "min not above max", fmt::format("min {}, max {}", zoom.min, zoom.max));
  return zoom;
}

// The finest zoom must reach the resolution that the mission requires.
void check_zoom_reaches_resolution(const YamlNode& node, const Mission& mission, double lat_deg) {
  const double finest_m = ground_resolution_m(mission.zoom.max, lat_deg);
  if (finest_m <= mission.min_resolution_m) return;
  refuse(node, fmt::format("a resolution that zoom {} reaches: {:.3f} m or coarser", mission.zoom.max, finest_m),
         fmt::format("{} m", mission.min_resolution_m), "raise zoom.max or min_resolution_m");
}

std::vector<std::string> read_airframes(const YamlNode& node) {
  std::vector<std::string> airframes;
  for (const YamlNode& item : node.items()) {
    airframes.push_back(read_id(item));
    if (std::count(airframes.begin(), airframes.end(), airframes.back()) > 1) item.reject("each airframe once");
  }
  if (airframes.empty()) refuse(node, "at least one airframe; \"any\" for all", "an empty list");
  return airframes;
}

IntegrityRequirement read_integrity(const YamlNode& node) {
  node.allow_only({"risk", "alert_limit_m", "time_to_alert_s"});
  IntegrityRequirement integrity;
  if (const auto risk = node.optional("risk")) {
    integrity.risk =
        number_between(*risk, kMinIntegrityRisk, kMaxIntegrityRisk, "of being outside the protection level, per look");
  }
  if (const auto limit = node.optional("alert_limit_m")) {
    integrity.alert_limit_m = number_between(*limit, kMinAlertLimit_m, kMaxAlertLimit_m, "metres");
  }
  if (const auto time = node.optional("time_to_alert_s")) {
    integrity.time_to_alert_s = number_between(*time, kMinTimeToAlert_s, kMaxTimeToAlert_s, "seconds");
  }
  return integrity;
}

void read_root(const YamlNode& root, PartReader& reader, Mission& mission) {
  std::optional<LonLat> takeoff;
  bool has_created = false, has_zoom = false;
  reader.attempt([&] {
    root.allow_only({"schema", "id", "series", "sequence", "created", "expires", "takeoff", "terrain", "zoom",
                     "min_resolution_m", "budget_mb", "freshness_days", "airframes", "sectors", "route", "no_fly",
                     "integrity"});
  });
  reader.attempt([&] {
    const YamlNode schema = root.required("schema");
    if (schema.text() != kMissionSchema) schema.reject(fmt::format("\"{}\"", kMissionSchema));
  });
  reader.attempt([&] { mission.id = read_id(root.required("id")); });
  reader.attempt([&] { mission.series = read_id(root.required("series")); });
  reader.attempt([&] { mission.sequence = integer_between(root.required("sequence"), 1, std::int64_t{1} << 53); });
  reader.attempt([&] {
    mission.created = read_time(root.required("created"));
    has_created = true;
  });
  reader.attempt([&] {
    const YamlNode node = root.required("expires");
    mission.expires = read_time(node);
    if (has_created && mission.expires <= mission.created) {
      node.reject("a time after created (" + to_rfc3339(mission.created) + ")");
    }
  });
  reader.attempt([&] {
    const YamlNode node = root.required("takeoff");
    node.allow_only({"lon_deg", "lat_deg"});
    takeoff = checked_place(node.required("lon_deg"), node.required("lat_deg"));
    mission.takeoff = *takeoff;
  });
  reader.attempt([&] { mission.terrain = read_terrain(root.required("terrain")); });
  reader.attempt([&] {
    mission.zoom = read_zoom(root.required("zoom"));
    has_zoom = true;
  });
  reader.attempt([&] {
    const YamlNode node = root.required("min_resolution_m");
    mission.min_resolution_m = positive_up_to(node, 1000, "metres");
    if (has_zoom && takeoff) check_zoom_reaches_resolution(node, mission, takeoff->lat_deg);
  });
  reader.attempt([&] { mission.budget_mb = integer_between(root.required("budget_mb"), 1, kMaxBudget_mb); });
  reader.attempt([&] {
    const YamlNode node = root.required("freshness_days");
    node.allow_only({"stable", "active"});
    mission.freshness_days.stable = static_cast<int>(integer_between(node.required("stable"), 1, kMaxFreshness_days));
    mission.freshness_days.active = static_cast<int>(integer_between(node.required("active"), 1, kMaxFreshness_days));
  });
  reader.attempt([&] { mission.airframes = read_airframes(root.required("airframes")); });
  reader.attempt([&] { read_sectors(root.required("sectors"), takeoff, reader, mission); });
  reader.attempt([&] {
    const YamlNode node = root.required("route");
    mission.route = read_route(node, takeoff);
    if (mission.route.points.empty() && root.required("sectors").items().empty()) {
      refuse(node, "a route, or sectors: a mission needs ground", "no points and no sectors");
    }
  });
  reader.attempt([&] {
    if (const auto node = root.optional("no_fly")) read_no_fly(*node, takeoff, reader, mission);
  });
  reader.attempt([&] {
    if (const auto node = root.optional("integrity")) mission.integrity = read_integrity(*node);
  });
}

}  // namespace

MissionReading parse_mission(std::string_view yaml, std::string_view name) {
  MissionReading reading;
  Mission mission;
  PartReader reader(reading.findings);
  reader.attempt([&] { read_root(YamlNode::parse(yaml, name), reader, mission); });
  if (reading.findings.empty()) reading.mission = std::move(mission);
  return reading;
}

std::string_view name_of(HeightFrame frame) {
  switch (frame) {
    case HeightFrame::above_ground: return "above_ground";
    case HeightFrame::above_takeoff: return "above_takeoff";
    case HeightFrame::above_sea_level: return "above_sea_level";
  }
  return "above_ground";
}

std::string height_frames_of(const Route& route) {
  std::string text;
  for (const HeightFrame frame : kHeightFrames) {
    const bool there = route.height_frames.empty() ? frame == route.height_frame
                                                   : std::find(route.height_frames.begin(), route.height_frames.end(),
                                                               frame) != route.height_frames.end();
    if (there) text += (text.empty() ? "" : " and ") + std::string(name_of(frame));
  }
  return text;
}

std::string_view name_of(SectorClass cls) { return cls == SectorClass::stable ? "stable" : "active"; }

bool Mission::allows(std::string_view airframe) const {
  return std::any_of(airframes.begin(), airframes.end(),
                     [airframe](const std::string& allowed) { return allowed == kAnyAirframe || allowed == airframe; });
}

MissionReading check_mission(const std::filesystem::path& path) {
  return parse_mission(read_text_file(path, std::uint64_t{1} << 20), path.string());
}

Mission read_mission(const std::filesystem::path& path) {
  MissionReading reading = check_mission(path);
  if (reading.mission) return std::move(*reading.mission);
  const Finding& first = reading.findings.items().front();
  const std::size_t more = reading.findings.items().size() - 1;
  throw UsageError(
      {.what = "the mission file is not valid",
       .where = first.where,
       .expected = first.expected,
       .found = first.found,
       .fix = more == 0 ? first.fix : "`nadir mission check` shows this and " + std::to_string(more) + " more"});
}

LocalFrame mission_frame(const Mission& mission) { return LocalFrame(mission.takeoff, mission.terrain.height_m); }

Region region_of(const Sector& sector, const LocalFrame& frame) {
  Region region{{to_plane(frame, sector.polygon)}, {}};
  if (sector.buffer_m > 0) {
    Corridor rim{region.rings.front(), sector.buffer_m};
    rim.path.push_back(rim.path.front());
    region.corridors.push_back(std::move(rim));
  }
  return region;
}

Region corridor_of(const Route& route, const LocalFrame& frame) {
  Region region;
  if (!route.points.empty()) {
    region.corridors.push_back({to_plane(frame, route.points), route.corridor_half_width_m});
  }
  return region;
}

Region required_region(const Mission& mission, const LocalFrame& frame) {
  Region region = corridor_of(mission.route, frame);
  for (const Sector& sector : mission.sectors) {
    Region one = region_of(sector, frame);
    region.rings.push_back(std::move(one.rings.front()));
    for (Corridor& rim : one.corridors) region.corridors.push_back(std::move(rim));
  }
  return region;
}

double height_above_ground_m(const Mission& mission, std::size_t point, double ground_m, double takeoff_ground_m) {
  const Route& route = mission.route;
  if (route.heights_m.empty()) return route.agl_m;
  const double height_m = route.heights_m.at(point);
  switch (route.frame_at(point)) {
    case HeightFrame::above_ground: return height_m;
    case HeightFrame::above_takeoff: return height_m + takeoff_ground_m - ground_m;
    case HeightFrame::above_sea_level: return height_m - ground_m;
  }
  return height_m;
}

}  // namespace nadir
