#include "planning/mission_document.hpp"

#include <nlohmann/json.hpp>

#include "mission_formats/mission_drawing.hpp"

namespace nadir {
namespace {

using nlohmann::json;

constexpr std::string_view kName = "document";

json points_json(const std::vector<LonLat>& points, bool closed) {
  json list = json::array();
  for (const LonLat& point : points) list.push_back({point.lon_deg, point.lat_deg});
  if (closed && !points.empty()) list.push_back(list.front());
  return list;
}

json place_json(LonLat place) { return {{"lon_deg", place.lon_deg}, {"lat_deg", place.lat_deg}}; }

json sector_json(const Sector& sector) {
  json document = {{"id", sector.id}, {"class", name_of(sector.cls)}, {"polygon", points_json(sector.polygon, true)}};
  if (sector.buffer_m > 0) document["buffer_m"] = sector.buffer_m;
  return document;
}

json no_fly_json(const NoFlyArea& area) {
  if (!area.polygon.empty()) return {{"id", area.id}, {"polygon", points_json(area.polygon, true)}};
  json circle = place_json(area.centre);
  circle["radius_m"] = area.radius_m;
  return {{"id", area.id}, {"circle", std::move(circle)}};
}

json route_json(const Route& route) {
  json document = {{"corridor_half_width_m", route.corridor_half_width_m},
                   {"agl_m", route.agl_m},
                   {"points", points_json(route.points, false)}};
  if (route.heights_m.empty()) return document;
  json& heights = document["heights"] = {{"m", route.heights_m}};
  if (route.height_frames.empty()) heights["frame"] = name_of(route.height_frame);
  for (const HeightFrame frame : route.height_frames) heights["frames"].push_back(name_of(frame));
  return document;
}

// "document:3:4 (route.points[2])": the path.
std::string path_in(const std::string& where) {
  const std::size_t open = where.find(" (");
  if (!where.starts_with(kName) || open == std::string::npos || !where.ends_with(')')) return {};
  return where.substr(open + 2, where.size() - open - 3);
}

}  // namespace

json document_from(const Mission& mission) {
  json document = {
      {"schema", kMissionSchema},
      {"id", mission.id},
      {"series", mission.series},
      {"sequence", mission.sequence},
      {"created", to_rfc3339(mission.created)},
      {"expires", to_rfc3339(mission.expires)},
      {"takeoff", place_json(mission.takeoff)},
      {"terrain", {{"mode", mission.terrain.flat ? "flat" : "dem"}, {"height_m", mission.terrain.height_m}}},
      {"zoom", {{"min", mission.zoom.min}, {"max", mission.zoom.max}}},
      {"min_resolution_m", mission.min_resolution_m},
      {"budget_mb", mission.budget_mb},
      {"freshness_days", {{"stable", mission.freshness_days.stable}, {"active", mission.freshness_days.active}}},
      {"airframes", mission.airframes},
      {"sectors", json::array()},
      {"route", route_json(mission.route)}};
  for (const Sector& sector : mission.sectors) document["sectors"].push_back(sector_json(sector));
  for (const NoFlyArea& area : mission.no_fly) document["no_fly"].push_back(no_fly_json(area));
  if (mission.integrity != IntegrityRequirement{}) {
    document["integrity"] = {{"risk", mission.integrity.risk},
                             {"alert_limit_m", mission.integrity.alert_limit_m},
                             {"time_to_alert_s", mission.integrity.time_to_alert_s}};
  }
  return document;
}

json new_document(const std::string& id, UtcTime today) {
  Mission mission = usual_mission(today);
  mission.id = mission.series = id;
  json document = document_from(mission);
  document.erase("takeoff");
  return document;
}

MissionReading read_document(const json& document) {
  const std::string text = document.dump(-1, ' ', false, json::error_handler_t::replace);
  MissionReading raw = parse_mission(text, kName);
  MissionReading reading{.mission = std::move(raw.mission), .findings = {}};
  for (Finding finding : raw.findings.items()) {
    finding.where = path_in(finding.where);
    reading.findings.add(std::move(finding));
  }
  return reading;
}

}  // namespace nadir
