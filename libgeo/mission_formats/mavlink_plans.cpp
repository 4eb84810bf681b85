#include "mission_formats/mavlink_plans.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <limits>
#include <map>
#include <nlohmann/json.hpp>

#include "base/json.hpp"
#include "base/plural.hpp"
#include "base/printable.hpp"
#include "package/mission_yaml.hpp"

namespace nadir {
namespace {

using nlohmann::json;

constexpr std::size_t kMaxItems = 20'000;
constexpr int kMaxPlanDepth = 16;
constexpr int kSeaLevelFrame = 0, kTakeoffFrame = 3, kGroundFrame = 10;
constexpr int kWaypoint = 16, kTakeoff = 22;
constexpr int kFencePolygonInclusion = 5001, kFencePolygonExclusion = 5002, kFenceCircleInclusion = 5003,
              kFenceCircleExclusion = 5004;

struct MissionItem {
  std::string where;
  int command = 0;
  int frame = 0;
  std::array<double, 7> params{};  // NaN: not stated
};

bool flies_to_a_place(int command) {
  for (const int one : {kWaypoint, 17, 18, 19, 21, kTakeoff, 31, 82, 84, 85}) {
    if (command == one) return true;
  }
  return false;
}

std::string name_of_command(int command) {
  switch (command) {
    case 20: return "return to launch";
    case 177: return "a jump";
    case 5001:
    case 5003: return "a fence that includes";
    case 5100: return "a rally point";
    default: return fmt::format("command {}", command);
  }
}

std::string name_of_frame(int frame) {
  constexpr std::array kNames{"above sea level", "local, north-east-down", "none (mission)", "above take-off",
                              "local, east-north-up"};
  if (frame >= 0 && frame < static_cast<int>(kNames.size()))
    return fmt::format("{} ({})", frame, kNames[static_cast<std::size_t>(frame)]);
  return fmt::format("{}", frame);
}

std::optional<HeightFrame> height_frame_of(int frame) {
  switch (frame) {
    case 0:
    case 5: return HeightFrame::above_sea_level;
    case 3:
    case 6: return HeightFrame::above_takeoff;
    case 10:
    case 11: return HeightFrame::above_ground;
    default: return std::nullopt;
  }
}

LonLat checked_place(double lon_deg, double lat_deg, const std::string& where) {
  if (!std::isfinite(lon_deg) || !std::isfinite(lat_deg) || std::abs(lon_deg) > 180 || std::abs(lat_deg) > 90) {
    const bool swapped = std::abs(lon_deg) <= 90 && std::abs(lat_deg) <= 180;
    throw UsageError({.what = "a coordinate is outside of the world",
                      .where = where,
                      .expected = "latitudes from -90° to 90°, longitudes from -180° to 180°",
                      .found = fmt::format("latitude {}, longitude {}", lat_deg, lon_deg),
                      .fix = swapped ? "longitude and latitude are swapped: correct the file" : "correct the file"});
  }
  return {lon_deg, lat_deg};
}

// Makes the route of items, one by one.
class RouteOfItems {
 public:
  RouteOfItems(std::string where, MissionDrawing& drawing) : where_(std::move(where)), drawing_(drawing) {
    line_.name = "route";
  }

  void add(const MissionItem& item) {
    if (!flies_to_a_place(item.command)) {
      ++left_out_[name_of_command(item.command)];
      return;
    }
    const double lat = item.params[4], lon = item.params[5], height_m = item.params[6];
    const bool here = !std::isfinite(lat) || !std::isfinite(lon) || (lat == 0 && lon == 0);
    if (here && item.command == kWaypoint) {
      throw UsageError({.what = "a waypoint has no place",
                        .where = item.where,
                        .expected = "a latitude and a longitude",
                        .found = fmt::format("{}, {}", lat, lon),
                        .fix = "set it in the ground station"});
    }
    if (here) {  // "at the present place"
      ++left_out_[item.command == kTakeoff ? "a take-off at the take-off point"
                                           : name_of_command(item.command) + " without a place"];
      return;
    }
    const auto frame = height_frame_of(item.frame);
    if (!frame) {
      throw UsageError({.what = "an item's frame is not supported",
                        .where = item.where,
                        .expected = "heights above sea level (0), above take-off (3) or above ground (10)",
                        .found = "frame " + name_of_frame(item.frame),
                        .fix = "choose another altitude mode in the ground station"});
    }
    add(checked_place(lon, lat, item.where), height_m, *frame, item.where);
  }

  void add(LonLat place, double height_m, HeightFrame frame, const std::string& where) {
    if (!std::isfinite(height_m)) {
      throw UsageError({.what = "an item has no height",
                        .where = where,
                        .expected = "a height in metres",
                        .fix = "state it in the ground station"});
    }
    if (!line_.frame) line_.frame = frame;
    line_.points.push_back(place);
    line_.heights_m.push_back(height_m);
    line_.frames.push_back(frame);
  }

  void leave_out(const std::string& what) { ++left_out_[what]; }

  void finish() {
    const bool mixed = std::any_of(line_.frames.begin(), line_.frames.end(),
                                   [&](HeightFrame one) { return one != line_.frames.front(); });
    if (!mixed) line_.frames.clear();
    if (!line_.points.empty()) drawing_.lines.push_back(std::move(line_));
    for (const auto& [what, times] : left_out_) {
      drawing_.notes.add({.code = "import.left_out",
                          .severity = Severity::note,
                          .where = where_,
                          .expected = "places that are flown to",
                          .found = times == 1 ? what : fmt::format("{}, {} times", what, times)});
    }
  }

 private:
  std::string where_;
  MissionDrawing& drawing_;
  DrawnLine line_;
  std::map<std::string, std::size_t> left_out_;
};

class PlanReader {
 public:
  PlanReader(const json& document, const std::string& where)
      : plan_(document, {.name = where, .what = "cannot import this plan", .fix = "save it again with QGroundControl"}),
        route_(where, drawing_) {}

  MissionDrawing read() {
    plan_.expect("fileType", "Plan");
    static_cast<void>(plan_.integer<int>("version", 1, 1));
    const JsonReader mission = plan_.object("mission");
    static_cast<void>(mission.optional_integer<int>("version", 1, 2));
    read_home(mission);
    read_items(mission.array("items", {0, kMaxItems}), 0);
    if (const auto fence = plan_.optional_object("geoFence")) read_fence(*fence);
    if (const auto rally = plan_.optional_object("rallyPoints")) {
      if (const auto points = rally->optional_array("points")) {
        for (std::size_t i = 0; i < points->size(); ++i) route_.leave_out("a rally point");
      }
    }
    if (const auto own = plan_.optional_object("nadir")) {
      drawing_.mission_text = own->text("mission", {0, std::size_t{1} << 20});
      if (const auto sectors = own->optional_array("sectors", {0, 256})) {
        for (std::size_t i = 0; i < sectors->size(); ++i) {
          const JsonReader sector = sectors->object(i);
          drawing_.areas.push_back(
              {sector.text("id"), AreaKind::sector, places(sector.array("polygon", {3, 4096})), {}, 0});
        }
      }
    }
    route_.finish();
    return std::move(drawing_);
  }

 private:
  static double number_or_nan(const JsonReader& list, std::size_t i) {
    return list.is_null(i) ? std::numeric_limits<double>::quiet_NaN() : list.number(i);
  }

  // [latitude, longitude], or with a height.
  static LonLat place(const JsonReader& pair) { return checked_place(pair.number(1), pair.number(0), pair.where()); }

  static std::vector<LonLat> places(const JsonReader& list) {
    std::vector<LonLat> points;
    for (std::size_t i = 0; i < list.size(); ++i) points.push_back(place(list.array(i, {2, 3})));
    return points;
  }

  void read_home(const JsonReader& mission) {
    if (!mission.has("plannedHomePosition")) return;
    const JsonReader home = mission.array("plannedHomePosition", {2, 3});
    if (home.is_null(0) || home.is_null(1) || (home.number(0) == 0 && home.number(1) == 0)) return;
    drawing_.takeoff = place(home);
    if (home.size() == 3 && !home.is_null(2)) take_height(home.number(2));
  }

  void take_height(double height_m) {
    if (height_m >= -500 && height_m <= 9000) drawing_.takeoff_height_m = height_m;
  }

  void read_items(const JsonReader& items, int nesting) {
    for (std::size_t i = 0; i < items.size(); ++i) {
      const JsonReader item = items.object(i);
      const std::string type = item.optional_text("type").value_or("SimpleItem");
      if (type == "SimpleItem") {
        read_simple(item);
      } else if (type == "ComplexItem" && nesting == 0) {
        read_complex(item);
      } else {
        item.refuse("type", "\"SimpleItem\" or \"ComplexItem\"");
      }
    }
  }

  void read_simple(const JsonReader& item) {
    MissionItem read{item.where(), item.integer<int>("command", 0, 65'535), item.integer<int>("frame", 0, 255), {}};
    // Until 2017 the place stood beside four parameters.
    constexpr std::size_t kPlainParams = 4, kAllParams = 7;
    const auto place = item.optional_array("coordinate", {3, 3});
    const std::size_t stated = place ? kPlainParams : kAllParams;
    const JsonReader params = item.array("params", {stated, stated});
    for (std::size_t i = 0; i < stated; ++i) read.params[i] = number_or_nan(params, i);
    for (std::size_t i = stated; i < kAllParams; ++i) read.params[i] = number_or_nan(*place, i - kPlainParams);
    route_.add(read);
  }

  void read_complex(const JsonReader& item) {
    const std::string type = item.text("complexItemType");
    if (type == "survey" || type == "CorridorScan") {
      const JsonReader transects = item.object("TransectStyleComplexItem");
      read_items(transects.array("Items", {0, kMaxItems}), 1);
      if (type == "survey" && item.has("polygon")) {
        drawing_.areas.push_back({"survey", AreaKind::sector, places(item.array("polygon", {3, 4096})), {}, 0});
      }
    } else if (type == "fwLandingPattern" || type == "vtolLandingPattern") {
      const bool relative = item.optional_boolean("altitudesAreRelative").value_or(true);
      const HeightFrame frame = relative ? HeightFrame::above_takeoff : HeightFrame::above_sea_level;
      for (const char* name : {item.has("landingApproachCoordinate") ? "landingApproachCoordinate" : "loiterCoordinate",
                               "landCoordinate"}) {
        const JsonReader at = item.array(name, {3, 3});
        route_.add(place(at), number_or_nan(at, 2), frame, item.where() + " (" + name + ")");
      }
    } else {
      throw UsageError({.what = "a complex item is not supported",
                        .where = item.where(),
                        .expected = "a survey, a corridor scan or a landing pattern",
                        .found = printable(type),
                        .fix = "export it as waypoints"});
    }
  }

  void read_fence(const JsonReader& fence) {
    // Of version 1: one polygon to stay inside of.
    if (const auto only = fence.optional_array("polygon"); only && only->size() > 0)
      route_.leave_out("a fence that includes");
    if (const auto polygons = fence.optional_array("polygons", {0, 256})) {
      for (std::size_t i = 0; i < polygons->size(); ++i) {
        const JsonReader one = polygons->object(i);
        if (one.optional_boolean("inclusion").value_or(false)) {
          route_.leave_out("a fence that includes");
        } else {
          drawing_.areas.push_back({one.optional_text("nadir_id").value_or(""),
                                    AreaKind::no_fly,
                                    places(one.array("polygon", {3, 4096})),
                                    {},
                                    0});
        }
      }
    }
    if (const auto circles = fence.optional_array("circles", {0, 256})) {
      for (std::size_t i = 0; i < circles->size(); ++i) {
        const JsonReader one = circles->object(i);
        if (one.optional_boolean("inclusion").value_or(false)) {
          route_.leave_out("a fence that includes");
          continue;
        }
        const JsonReader circle = one.object("circle");
        drawing_.areas.push_back({one.optional_text("nadir_id").value_or(""),
                                  AreaKind::no_fly,
                                  {},
                                  place(circle.array("center", {2, 3})),
                                  circle.number("radius", 0.001, 200'000)});
      }
    }
  }

  JsonReader plan_;
  MissionDrawing drawing_;
  RouteOfItems route_;
};

// One row of a waypoint file: index, current, frame, command, four parameters, latitude, longitude, height,
// autocontinue.
constexpr std::size_t kColumns = 12;

std::vector<std::string_view> words_of(std::string_view line) {
  std::vector<std::string_view> words;
  std::size_t at = 0;
  while (words.size() <= kColumns) {
    at = line.find_first_not_of(" \t\r", at);
    if (at == std::string_view::npos) break;
    const std::size_t end = std::min(line.find_first_of(" \t\r", at), line.size());
    words.push_back(line.substr(at, end - at));
    at = end;
  }
  return words;
}

double number_of(std::string_view word, const std::string& where) {
  double value = 0;
  if (word.starts_with('+')) word.remove_prefix(1);
  const auto [end, code] = std::from_chars(word.data(), word.data() + word.size(), value);
  if (code != std::errc() || end != word.data() + word.size()) {
    throw UsageError({.what = "a row of the waypoints is not readable",
                      .where = where,
                      .expected = "a number",
                      .found = printable(word.substr(0, 60)),
                      .fix = "save the waypoints again in the ground station"});
  }
  return value;
}

int integer_of(std::string_view word, int most, const std::string& where) {
  const double value = number_of(word, where);
  if (!(value >= 0 && value <= most) || value != std::floor(value)) {
    throw UsageError({.what = "a row of the waypoints is not readable",
                      .where = where,
                      .expected = fmt::format("a whole number from 0 to {}", most),
                      .found = printable(word.substr(0, 60)),
                      .fix = "save the waypoints again in the ground station"});
  }
  return static_cast<int>(value);
}

// Gathers the corners of a fence's polygons, which are items that each state how many there are.
class FenceReader {
 public:
  explicit FenceReader(MissionDrawing& drawing) : drawing_(drawing) {}

  bool take(const MissionItem& item) {
    if (item.command == kFenceCircleExclusion) {
      if (!(item.params[0] > 0 && item.params[0] <= 200'000))
        refuse(item, "a radius in metres in the first parameter", item.params[0]);
      drawing_.areas.push_back(
          {"", AreaKind::no_fly, {}, checked_place(item.params[5], item.params[4], item.where), item.params[0]});
      return true;
    }
    if (item.command != kFencePolygonExclusion) return false;
    if (!(item.params[0] >= 3 && item.params[0] <= 4096))
      refuse(item, "3 to 4096 corners in the first parameter", item.params[0]);
    if (!open_) drawing_.areas.push_back({"", AreaKind::no_fly, {}, {}, 0});
    open_ = item.where;
    drawing_.areas.back().polygon.push_back(checked_place(item.params[5], item.params[4], item.where));
    if (static_cast<double>(drawing_.areas.back().polygon.size()) >= item.params[0]) open_.reset();
    return true;
  }

  void finish() const {
    if (!open_) return;
    throw UsageError({.what = "a fence's polygon is not complete",
                      .where = *open_,
                      .expected = "as many corners as it states",
                      .fix = "save the fence again in the ground station"});
  }

 private:
  [[noreturn]] static void refuse(const MissionItem& item, std::string expected, double found) {
    throw UsageError({.what = "a fence is not readable",
                      .where = item.where,
                      .expected = std::move(expected),
                      .found = fmt::format("{}", found),
                      .fix = "save the fence again in the ground station"});
  }

  MissionDrawing& drawing_;
  std::optional<std::string> open_;  // the last corner's row
};

int frame_number(HeightFrame frame) {
  switch (frame) {
    case HeightFrame::above_ground: return kGroundFrame;
    case HeightFrame::above_takeoff: return kTakeoffFrame;
    case HeightFrame::above_sea_level: return kSeaLevelFrame;
  }
  return kGroundFrame;
}

struct FlownRoute {
  std::vector<int> frames;  // and heights: one for each point
  std::vector<double> heights_m;
};

// A route without heights is flown at agl_m: over flat terrain above the take-off point, which every autopilot can.
FlownRoute flown(const Mission& mission) {
  if (mission.route.points.empty()) {
    throw UsageError({.what = "the mission has no route",
                      .where = "mission " + mission.id,
                      .expected = "a route, for an autopilot to fly",
                      .found = "an area alone",
                      .fix = "export it as KML, GeoJSON or GeoPackage"});
  }
  const std::size_t points = mission.route.points.size();
  if (mission.route.heights_m.empty()) {
    return {std::vector<int>(points, mission.terrain.flat ? kTakeoffFrame : kGroundFrame),
            std::vector<double>(points, mission.route.agl_m)};
  }
  FlownRoute route{{}, mission.route.heights_m};
  for (std::size_t i = 0; i < points; ++i) route.frames.push_back(frame_number(mission.route.frame_at(i)));
  return route;
}

json pair_of(LonLat place) { return {place.lat_deg, place.lon_deg}; }

json pairs_of(const std::vector<LonLat>& points) {
  json list = json::array();
  for (const LonLat& point : points) list.push_back(pair_of(point));
  return list;
}

}  // namespace

bool is_waypoint_file(std::string_view text) { return text.starts_with("QGC WPL"); }

bool is_plan(std::string_view text) {
  const std::size_t start = text.find_first_not_of(" \t\r\n\xEF\xBB\xBF");
  if (start == std::string_view::npos || text[start] != '{') return false;
  return text.find("\"fileType\"") != std::string_view::npos ||
         text.find("\"groundStation\"") != std::string_view::npos ||
         text.find("\"MAV_AUTOPILOT\"") != std::string_view::npos;
}

MissionDrawing read_plan(std::string_view text, const std::string& where) {
  const json document = parse_json(text, where, {.max_depth = kMaxPlanDepth});
  if (!document.is_object() || !document.contains("fileType")) {
    throw UsageError({.what = "the file is a mission of an old QGroundControl",
                      .where = where,
                      .expected = "a plan: \"fileType\": \"Plan\"",
                      .found = "none",
                      .fix = "open it in a current QGroundControl and save it as .plan"});
  }
  return PlanReader(document, where).read();
}

MissionDrawing read_waypoints(std::string_view text, const std::string& where) {
  MissionDrawing drawing;
  drawing.holds_areas = false;
  RouteOfItems route(where, drawing);
  FenceReader fence(drawing);
  std::size_t number = 0, items = 0;
  while (!text.empty()) {
    const std::size_t end = std::min(text.find('\n'), text.size());
    const std::string_view line = text.substr(0, end);
    text.remove_prefix(std::min(end + 1, text.size()));
    const std::string at = fmt::format("{}:{}", where, ++number);
    if (number == 1) {
      const auto words = words_of(line);
      if (words.size() != 3 || words[0] != "QGC" || words[1] != "WPL" || (words[2] != "110" && words[2] != "120")) {
        throw UsageError({.what = "the waypoints have another version",
                          .where = at,
                          .expected = "QGC WPL 110",
                          .found = printable(line.substr(0, 60)),
                          .fix = "save the waypoints again in the ground station"});
      }
      continue;
    }
    const auto words = words_of(line);
    if (words.empty() || words[0].starts_with('#')) continue;
    if (words.size() != kColumns) {
      throw UsageError({.what = "a row of the waypoints is not readable",
                        .where = at,
                        .expected = fmt::format("{} columns", kColumns),
                        .found = words.size() > kColumns ? "more" : count(words.size(), "column"),
                        .fix = "save the waypoints again in the ground station"});
    }
    if (++items > kMaxItems) {
      throw UsageError(
          {.what = "there are too many waypoints", .where = at, .expected = fmt::format("at most {}", kMaxItems)});
    }
    MissionItem item{at, integer_of(words[3], 65'535, at), integer_of(words[2], 255, at), {}};
    for (std::size_t i = 0; i < 7; ++i) item.params[i] = number_of(words[4 + i], at);
    const bool home = items == 1 && integer_of(words[0], 65'535, at) == 0 && item.command == kWaypoint &&
                      item.frame == kSeaLevelFrame;
    if (home) {
      if (item.params[4] == 0 && item.params[5] == 0) continue;
      drawing.takeoff = checked_place(item.params[5], item.params[4], at);
      if (item.params[6] >= -500 && item.params[6] <= 9000) drawing.takeoff_height_m = item.params[6];
    } else if (!fence.take(item)) {
      route.add(item);
    }
  }
  fence.finish();
  route.finish();
  if (!drawing.areas.empty()) drawing.holds_areas = true;
  return drawing;
}

std::string mission_as_plan(const Mission& mission) {
  const FlownRoute route = flown(mission);
  json items = json::array();
  for (std::size_t i = 0; i < mission.route.points.size(); ++i) {
    const LonLat& at = mission.route.points[i];
    const double height_m = route.heights_m[i];
    items.push_back({{"type", "SimpleItem"},
                     {"autoContinue", true},
                     {"command", kWaypoint},
                     {"doJumpId", i + 1},
                     {"frame", route.frames[i]},
                     {"Altitude", height_m},
                     {"AltitudeMode", route.frames[i] == kSeaLevelFrame  ? 2
                                      : route.frames[i] == kTakeoffFrame ? 1
                                                                         : 4},
                     {"AMSLAltAboveTerrain", nullptr},
                     {"params", {0, 0, 0, nullptr, at.lat_deg, at.lon_deg, height_m}}});
  }
  json polygons = json::array(), circles = json::array(), sectors = json::array();
  for (const NoFlyArea& area : mission.no_fly) {
    if (area.polygon.empty()) {
      circles.push_back({{"circle", {{"center", pair_of(area.centre)}, {"radius", area.radius_m}}},
                         {"inclusion", false},
                         {"version", 1},
                         {"nadir_id", area.id}});
    } else {
      polygons.push_back(
          {{"polygon", pairs_of(area.polygon)}, {"inclusion", false}, {"version", 1}, {"nadir_id", area.id}});
    }
  }
  for (const Sector& sector : mission.sectors)
    sectors.push_back({{"id", sector.id}, {"polygon", pairs_of(sector.polygon)}});
  const json plan{
      {"fileType", "Plan"},
      {"version", 1},
      {"groundStation", "QGroundControl"},
      {"mission",
       {{"version", 2},
        {"firmwareType", 0},
        {"vehicleType", 1},
        {"cruiseSpeed", 15},
        {"hoverSpeed", 5},
        {"globalPlanAltitudeMode", 0},
        {"plannedHomePosition", {mission.takeoff.lat_deg, mission.takeoff.lon_deg, mission.terrain.height_m}},
        {"items", items}}},
      {"geoFence", {{"version", 2}, {"polygons", polygons}, {"circles", circles}}},
      {"rallyPoints", {{"version", 2}, {"points", json::array()}}},
      {"nadir", {{"mission", mission_yaml(mission)}, {"sectors", sectors}}}};
  return plan.dump(1) + "\n";
}

std::string mission_as_waypoints(const Mission& mission) {
  const FlownRoute route = flown(mission);
  std::string text = "QGC WPL 110\n";
  const auto row = [&](std::size_t index, int frame, LonLat at, double height_m) {
    text += fmt::format("{}\t{}\t{}\t{}\t0\t0\t0\t0\t{}\t{}\t{}\t1\n", index, index == 0 ? 1 : 0, frame, kWaypoint,
                        at.lat_deg, at.lon_deg, height_m);
  };
  row(0, kSeaLevelFrame, mission.takeoff, mission.terrain.height_m);
  for (std::size_t i = 0; i < mission.route.points.size(); ++i) {
    row(i + 1, route.frames[i], mission.route.points[i], route.heights_m[i]);
  }
  return text;
}

}  // namespace nadir
