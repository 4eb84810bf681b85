#include "mission_formats/mission_drawing.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "base/plural.hpp"
#include "base/printable.hpp"
#include "base/quantile.hpp"
#include "package/mission_yaml.hpp"

namespace nadir {
namespace {

constexpr std::int64_t kSecondsPerDay = 86'400;
constexpr double kFar_m = 200'000;  // a mission's largest distance from its take-off
constexpr std::size_t kNamedLines = 10;
constexpr double kUsualHalfWidth_m = 100, kUsualAgl_m = 120;

// By which a line is chosen: its name, or its number where it has none or shares it with others, as drawings of GIS
// programs do.
std::vector<std::string> names_to_choose(const std::vector<DrawnLine>& lines) {
  std::vector<std::string> names;
  for (const DrawnLine& line : lines) {
    const auto same =
        std::count_if(lines.begin(), lines.end(), [&](const auto& other) { return other.name == line.name; });
    names.push_back(line.name.empty() || same > 1 ? fmt::format("line {}", names.size() + 1) : line.name);
  }
  return names;
}

const DrawnLine* choose_route(const MissionDrawing& drawing, const MissionImportOptions& options,
                              const std::string& where) {
  const std::vector<std::string> names = names_to_choose(drawing.lines);
  if (options.route) {
    const auto chosen = std::find(names.begin(), names.end(), *options.route);
    if (chosen != names.end()) return &drawing.lines[static_cast<std::size_t>(chosen - names.begin())];
  } else if (drawing.lines.size() == 1) {
    return &drawing.lines.front();
  } else if (drawing.lines.empty() && !drawing.areas.empty()) {
    return nullptr;  // an area alone
  }
  std::string found = drawing.lines.empty() ? "no lines" : count(drawing.lines.size(), "line") + ":";
  for (std::size_t i = 0; i < std::min(names.size(), kNamedLines); ++i) {
    found += fmt::format("{} \"{}\"", i > 0 ? "," : "", printable(names[i]));
  }
  if (names.size() > kNamedLines) found += ", …";
  if (drawing.lines.empty()) {
    for (const Finding& note : drawing.notes.items()) found += "; " + note.found;
  }
  throw UsageError(
      {.what = "it is unclear which line is the route",
       .where = where,
       .expected = options.route ? "one line named \"" + *options.route + "\"" : "one line, or areas alone",
       .found = found,
       .fix = drawing.lines.empty() ? "draw the route as a line" : "select one: --route NAME"});
}

// Ids take letters, digits, '-', '_' and '.'.
std::string id_from(const std::string& name, const std::string& otherwise, std::set<std::string>& taken) {
  std::string id;
  for (const char c : name) {
    const bool plain = (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9');
    if (plain || (!id.empty() && (c == '-' || c == '_' || c == '.'))) {
      id += c;
    } else if (!id.empty() && id.back() != '-') {
      id += '-';
    }
  }
  id = id.substr(0, 64);
  while (!id.empty() && id.back() == '-') id.pop_back();
  if (id.empty()) id = otherwise;
  std::string unique = id;
  for (int n = 2; !taken.insert(unique).second; ++n) unique = fmt::format("{}-{}", id.substr(0, 56), n);
  return unique;
}

bool named_no_fly(const std::string& name) {
  std::string plain;
  for (const char c : name) {
    if (c >= 'A' && c <= 'Z') plain += static_cast<char>(c - 'A' + 'a');
    if (c >= 'a' && c <= 'z') plain += c;
  }
  return plain.starts_with("nofly") || plain.starts_with("nfz") || plain.starts_with("exclusion");
}

// What usual_mission() fills in.
const std::set<std::string>& assumed_members() {
  static const std::set<std::string> members{
      "expires",   "takeoff",        "terrain",   "zoom",  "min_resolution_m",
      "budget_mb", "freshness_days", "airframes", "class", "corridor_half_width_m",
      "agl_m"};
  return members;
}

// level_before: the mission that the drawing belongs to is flown at one height above ground.
void take_route(const DrawnLine& line, const MissionImportOptions& options, bool level_before, const std::string& where,
                Mission& mission, Findings& notes) {
  Route& route = mission.route;
  route.points.clear();
  std::vector<double> heights;
  std::vector<HeightFrame> frames;
  for (std::size_t i = 0; i < line.points.size(); ++i) {
    if (!route.points.empty() && line.points[i] == route.points.back()) {
      if (!heights.empty()) heights.back() = line.heights_m[i];
      if (!frames.empty()) frames.back() = line.frames[i];
      continue;
    }
    route.points.push_back(line.points[i]);
    if (!line.heights_m.empty()) heights.push_back(line.heights_m[i]);
    if (!line.frames.empty()) frames.push_back(line.frames[i]);
  }
  if (route.points.size() < 2) {
    throw UsageError({.what = "the route has too few points",
                      .where = where,
                      .expected = "two points that differ, or more",
                      .found = count(route.points.size(), "point")});
  }
  route.heights_m.clear();
  route.height_frames.clear();
  const auto frame = line.frame ? line.frame : options.height_frame;
  if (heights.empty()) return;
  if (!frame) {
    notes.add({.code = "import.heights_ignored",
               .severity = Severity::warning,
               .where = where,
               .expected = "heights with a frame",
               .found = fmt::format("{:g} to {:g}, and nothing about above what",
                                    *std::min_element(heights.begin(), heights.end()),
                                    *std::max_element(heights.begin(), heights.end())),
               .fix = "name it: --height-frame above_ground, above_takeoff or above_sea_level"});
    return;
  }
  // The exporter writes a route without heights at agl_m, where the format needs heights.
  const bool level = std::all_of(heights.begin(), heights.end(), [&](double m) { return m == route.agl_m; });
  if (level_before && level && frames.empty() && *frame != HeightFrame::above_sea_level) return;
  route.height_frame = frames.empty() ? *frame : frames.front();
  route.heights_m = std::move(heights);
  const bool mixed =
      std::any_of(frames.begin(), frames.end(), [&](HeightFrame one) { return one != route.height_frame; });
  if (mixed) route.height_frames = std::move(frames);
}

// A route's typical height above the ground, where the ground's height is known well enough.
std::optional<double> typical_agl_m(const Mission& mission) {
  std::vector<double> heights;
  for (std::size_t i = 0; i < mission.route.heights_m.size(); ++i) {
    const double agl_m = height_above_ground_m(mission, i, mission.terrain.height_m, mission.terrain.height_m);
    if (agl_m >= 10 && agl_m <= 10'000) heights.push_back(agl_m);  // without take-off and landing
  }
  if (heights.empty()) return std::nullopt;
  return median(std::move(heights));
}

void take_areas(const MissionDrawing& drawing, const MissionImportOptions& options, Mission& mission) {
  const std::vector<Sector> sectors_before = std::move(mission.sectors);
  mission.sectors.clear();
  mission.no_fly.clear();
  std::set<std::string> sector_ids, no_fly_ids;
  for (const DrawnArea& area : drawing.areas) {
    const bool no_fly = area.kind == AreaKind::no_fly || area.polygon.empty() || options.no_fly.contains(area.name) ||
                        (area.kind == AreaKind::unstated && named_no_fly(area.name));
    if (no_fly) {
      mission.no_fly.push_back({id_from(area.name, "no-fly", no_fly_ids), area.polygon, area.centre, area.radius_m});
      continue;
    }
    Sector sector{id_from(area.name, "sector", sector_ids), options.sector_class, area.polygon, 0};
    const auto before = std::find_if(sectors_before.begin(), sectors_before.end(),
                                     [&](const Sector& one) { return one.id == sector.id; });
    if (before != sectors_before.end()) sector.cls = before->cls, sector.buffer_m = before->buffer_m;
    if (options.buffer_m) sector.buffer_m = *options.buffer_m;
    mission.sectors.push_back(std::move(sector));
  }
}

double apart_m(const std::vector<LonLat>& points, LonLat from) {
  const LocalFrame frame(from);
  double nearest_m = INFINITY;
  for (const LonLat& point : points) {
    if (std::abs(point.lat_deg) > 90) return INFINITY;
    nearest_m = std::min(nearest_m, distance_m(frame.plane_from_lonlat(point), {}));
  }
  return nearest_m;
}

void refuse_swapped(const std::vector<LonLat>& points, LonLat reference, const std::string& what,
                    const std::string& where) {
  if (!looks_swapped(points, reference)) return;
  throw UsageError(
      {.what = "longitude and latitude are swapped",
       .where = where + ": " + what,
       .expected = fmt::format("places near {:.5f},{:.5f} (longitude, latitude)", reference.lon_deg, reference.lat_deg),
       .found = fmt::format("{:.5f},{:.5f}, which the other way round lies near", points.front().lon_deg,
                            points.front().lat_deg),
       .fix = "correct the file, or import it with --latitude-first"});
}

}  // namespace

Mission usual_mission(UtcTime today) {
  Mission mission;
  mission.sequence = 1;
  mission.created = UtcTime{today.unix_s / kSecondsPerDay * kSecondsPerDay};
  mission.expires = UtcTime{mission.created.unix_s + 30 * kSecondsPerDay};
  mission.zoom = {15, 19};
  mission.min_resolution_m = 0.5;
  mission.budget_mb = 500;
  mission.freshness_days = {730, 90};
  mission.airframes = {std::string(kAnyAirframe)};
  mission.route.corridor_half_width_m = kUsualHalfWidth_m;
  mission.route.agl_m = kUsualAgl_m;
  return mission;
}

bool looks_swapped(const std::vector<LonLat>& points, LonLat reference) {
  if (points.empty() || std::abs(reference.lat_deg) > 85) return false;
  std::vector<LonLat> exchanged;
  for (const LonLat& point : points) exchanged.push_back({point.lat_deg, point.lon_deg});
  return apart_m(points, reference) > kFar_m && apart_m(exchanged, reference) < kFar_m;
}

ImportedMission mission_from_drawing(const MissionDrawing& drawing, const MissionImportOptions& options,
                                     const std::string& where) {
  ImportedMission imported;
  imported.notes = drawing.notes;
  std::set<std::string> assumed;
  Mission mission;
  if (options.base) {
    mission = *options.base;
  } else if (drawing.mission_text) {
    const MissionReading inside = parse_mission(*drawing.mission_text, "the mission inside " + where);
    if (!inside.mission) {
      imported.reading.findings = inside.findings;
      return imported;
    }
    mission = *inside.mission;
  } else {
    if (!options.id) {
      throw UsageError({.what = "the mission needs an id",
                        .where = where,
                        .fix = "give one: --id ID, or --mission FILE for all that the drawing does not state"});
    }
    mission = usual_mission(options.today);
    assumed = assumed_members();
  }
  const bool has_base = assumed.empty();
  if (has_base) {
    for (const DrawnLine& line : drawing.lines) refuse_swapped(line.points, mission.takeoff, "the route", where);
    for (const DrawnArea& area : drawing.areas)
      refuse_swapped(area.polygon, mission.takeoff, "area \"" + area.name + "\"", where);
  }
  if (options.id) mission.id = mission.series = *options.id;

  const DrawnLine* line = choose_route(drawing, options, where);
  if (drawing.takeoff) mission.takeoff = *drawing.takeoff, assumed.erase("takeoff");
  if (line != nullptr) {
    if (drawing.takeoff) refuse_swapped(line->points, *drawing.takeoff, "the route", where);
    take_route(*line, options, has_base && mission.route.heights_m.empty(), where, mission, imported.notes);
    if (!has_base && !drawing.takeoff) mission.takeoff = mission.route.points.front();
  } else if (drawing.holds_areas) {
    mission.route.points.clear();
    mission.route.heights_m.clear();
    mission.route.height_frames.clear();
    if (!has_base && !drawing.takeoff)
      mission.takeoff =
          drawing.areas.front().polygon.empty() ? drawing.areas.front().centre : drawing.areas.front().polygon.front();
  }
  if (drawing.holds_areas) take_areas(drawing, options, mission);
  if (line != nullptr && !has_base) {
    for (const DrawnArea& area : drawing.areas)
      refuse_swapped(area.polygon, line->points.front(), "area \"" + area.name + "\"", where);
  }
  if (options.ground_m) {
    mission.terrain.height_m = *options.ground_m;
  } else if (!has_base && drawing.takeoff_height_m) {
    mission.terrain.height_m = *drawing.takeoff_height_m;
  }
  if (options.half_width_m) mission.route.corridor_half_width_m = *options.half_width_m;
  if (options.agl_m) {
    mission.route.agl_m = *options.agl_m;
  } else if (const auto agl_m = typical_agl_m(mission); agl_m && !has_base) {
    mission.route.agl_m = *agl_m;
  }
  imported.yaml = mission_yaml(mission, assumed);
  imported.reading = parse_mission(imported.yaml, "the mission from " + where);
  return imported;
}

}  // namespace nadir
