#include "desk/desk_missions.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <nlohmann/json.hpp>
#include <utility>
#include <variant>

#include "base/error.hpp"
#include "base/json.hpp"
#include "desk/desk_documents.hpp"
#include "http/json_body.hpp"
#include "http/multipart.hpp"
#include "map_page/map_page.hpp"
#include "package/mission_check.hpp"
#include "planning/imagery_coverage.hpp"
#include "planning/mission_document.hpp"
#include "planning/planning_room.hpp"

namespace nadir {
namespace {

using nlohmann::json;

constexpr std::size_t kMostTiles = 4000;        // of a layer
constexpr std::size_t kMostImageryTiles = 150;  // that coverage by imagery is looked at in: a second or two
constexpr std::size_t kMostSources = 100;       // of a job

json findings_list(const Findings& findings) {
  json list = json::array();
  for (const Finding& finding : findings.items()) {
    list.push_back({{"code", finding.code},
                    {"severity", name_of(finding.severity)},
                    {"where", finding.where},
                    {"expected", finding.expected},
                    {"found", finding.found},
                    {"fix", finding.fix}});
  }
  return list;
}

ApiResponse unknown(std::string type, std::string detail) {
  return answer({.status = 404, .type = std::move(type), .detail = std::move(detail)});
}

json box_json(const LonLatBox& box) { return {box.west_deg, box.south_deg, box.east_deg, box.north_deg}; }

json imagery_json(const ImagerySource& source) {
  const bool placed = source.pixel_m > 0;
  return {{"name", source.name},
          {"bounds", placed ? box_json(source.bounds) : json()},
          {"zooms", placed ? json{{"min", source.zooms.min}, {"max", source.zooms.max}} : json()},
          {"captured_at", source.captured_at ? json(to_rfc3339(*source.captured_at)) : json()},
          {"gsd_m", source.gsd_m > 0 ? json(source.gsd_m) : json()},
          {"ce90_m", source.ce90_m > 0 ? json(source.ce90_m) : json()},
          {"provider", source.provider},
          {"licence", source.licence},
          {"pixel_m", placed ? json(source.pixel_m) : json()},
          {"problem", source.problem.empty() ? json() : json(source.problem)}};
}

json planning_json(const PlanningRoom& room, UtcTime now) {
  json imagery = json::array(), elevation = json::array(), cameras = json::array(), keys = json::array();
  json vectors = json::array();
  const auto problem = [](const auto& source) { return source.problem.empty() ? json() : json(source.problem); };
  const MapSources& sources = room.sources();
  for (const ImagerySource& source : sources.imagery()) imagery.push_back(imagery_json(source));
  for (const NamedSource& source : sources.elevation())
    elevation.push_back({{"name", source.name}, {"problem", problem(source)}});
  for (const NamedSource& source : sources.cameras())
    cameras.push_back({{"name", source.name}, {"problem", problem(source)}});
  for (const NamedSource& source : sources.vectors())
    vectors.push_back({{"name", source.name}, {"problem", problem(source)}});
  for (const KeySource& key : sources.keys()) {
    keys.push_back({{"name", key.name},
                    {"keyid", key.keyid.empty() ? json() : json(key.keyid)},
                    {"appointed", key.appointed ? json(*key.appointed) : json()},
                    {"problem", problem(key)}});
  }
  return {{"imagery", std::move(imagery)},           {"elevation", std::move(elevation)},
          {"cameras", std::move(cameras)},           {"keys", std::move(keys)},
          {"vectors", std::move(vectors)},           {"trust", sources.trust().has_value()},
          {"defaults", new_document("mission", now)}};
}

json vectors_json(const Manifest& manifest) {
  const Artifact* const artifact = manifest.artifact(kRoleVectors);
  if (artifact == nullptr || !artifact->vectors) return {};
  const VectorFacts& facts = *artifact->vectors;
  return {{"attribution", facts.attribution},
          {"licence", facts.licence},
          {"roads", facts.roads},
          {"water", facts.water},
          {"woods", facts.woods},
          {"buildings", facts.buildings}};
}

json package_of(const PlanningRoom& room, const StoredMission& mission) {
  const std::shared_ptr<const PlannedPackage> package = room.package(mission);
  if (!package) return {};
  return {{"name", *room.package_name(mission)},
          {"tiles", package->sidecars.size()},
          {"bytes", package->bytes},
          {"signed", package->is_signed},
          {"zooms", {{"min", package->tiles->zooms().min}, {"max", package->tiles->zooms().max}}},
          {"bounds", box_json(package->manifest.bounds)},
          {"indexed", package->indexed()},
          {"matchability", package->matchability.has_value()},
          {"vectors", vectors_json(package->manifest)},
          {"of_this_mission", package->mission_text == mission.text}};
}

json mission_json(const PlanningRoom& room, const StoredMission& mission) {
  Findings findings = mission.reading.findings;
  json estimate;
  if (const auto figures = room.estimate(mission)) {
    estimate = estimate_json(*figures);
    estimate["build_minutes"] = figures->cpu_seconds / 60;
    findings.add(check_estimate(*mission.reading.mission, *figures));
  }
  if (mission.reading.mission) findings.add(check_plausibility(*mission.reading.mission));
  const auto current = room.prediction_is_current(mission);
  return {{"id", mission.id},
          {"revision", mission.revision},
          {"changed", to_rfc3339(mission.changed)},
          {"mission", json::parse(mission.document)},
          {"valid", mission.reading.mission.has_value()},
          {"findings", findings_list(findings)},
          {"estimate", std::move(estimate)},
          {"package", package_of(room, mission)},
          {"prediction", current ? json{{"of_this_mission", *current}} : json()},
          {"job", room.jobs().latest(mission.id)}};
}

json mission_line(const PlanningRoom& room, const StoredMission& mission) {
  const json document = json::parse(mission.document);
  const json job = room.jobs().latest(mission.id);
  const std::string state = job.is_object() ? job.value("state", "") : "";
  const bool active = state == "waiting" || state == "running";
  return {{"id", mission.id},
          {"name", document.contains("id") && document["id"].is_string() ? document["id"] : json("")},
          {"changed", to_rfc3339(mission.changed)},
          {"valid", mission.reading.mission.has_value()},
          {"package", room.package(mission) != nullptr},
          {"job", active ? json(state) : json()}};
}

ApiResponse create_mission(const ApiRequest& request, PlanningRoom& room) {
  auto name = read_body<std::string>(
      request, [](BodyFields& body, FieldErrors&) { return body.text("name", {.least = 1, .most = 200}); });
  if (const auto* problem = std::get_if<Problem>(&name)) return answer(*problem);
  return json_answer(201, mission_json(room, room.create(std::get<std::string>(name))));
}

ApiResponse import_mission(const ApiRequest& request, PlanningRoom& room) {
  auto query = parse_query(request.target);
  const auto take = [&](const char* name) -> std::optional<std::string> {
    if (auto found = query->extract(name); !found.empty()) return std::move(found.mapped());
    return std::nullopt;
  };
  const std::string detail = "?name is the file's name; ?id, ?route and ?latitude_first=true may be given";
  if (!query) return answer({.status = 400, .type = "query", .detail = detail});
  const auto name = take("name"), id = take("id"), route = take("route"), order = take("latitude_first");
  if (!name || name->empty() || !query->empty() || (order && *order != "true" && *order != "false")) {
    return answer({.status = 400, .type = "query", .detail = detail});
  }
  const ImportedDraft imported = room.import(*name, as_bytes(request.body), id, route, order == "true");
  return json_answer(201,
                     {{"mission", mission_json(room, imported.mission)}, {"notes", findings_list(imported.notes)}});
}

ApiResponse write_mission(const ApiRequest& request, PlanningRoom& room, const StoredMission& mission) {
  json body;
  try {
    body = parse_json(request.body, "the body", {.max_depth = 12, .allow_floats = true});
  } catch (const Error& error) {
    return answer({.status = 400, .type = "malformed", .detail = error.text().found});
  }
  if (!body.is_object() || body.size() != 2 || !body.contains("revision") || !body["revision"].is_number_integer() ||
      !body.contains("mission") || !body["mission"].is_object()) {
    return answer({.status = 400,
                   .type = "invalid",
                   .detail = "the body is {\"revision\": the mission's, \"mission\": the whole document}"});
  }
  return without_cache(json_answer(
      200,
      mission_json(room, room.missions().write(mission.id, body["revision"].get<std::int64_t>(), body["mission"]))));
}

std::variant<JobRequest, Problem> parse_job(const ApiRequest& request) {
  json body;
  const auto invalid = [](std::string detail) {
    return Problem{.status = 400, .type = "invalid", .detail = std::move(detail)};
  };
  try {
    body = parse_json(request.body, "the body", {.max_depth = 4, .allow_floats = false});
    const JsonReader in(body, {.name = "the body", .what = "cannot start this job"});
    JobRequest job;
    const JsonReader steps = in.array("steps", {.least = 1, .most = 7});
    for (std::size_t i = 0; i < steps.size(); ++i) {
      const auto step = package_step_of(steps.text(i));
      if (!step) steps.refuse(i, "estimate, build, index, matchability, sign, verify or predict");
      job.steps.push_back(*step);
    }
    if (const auto imagery = in.optional_array("imagery", {.most = kMostSources})) {
      for (std::size_t i = 0; i < imagery->size(); ++i) job.imagery.push_back(imagery->text(i, {.most = 255}));
    }
    const auto name = [&](const char* key) -> std::optional<std::string> {
      if (!in.has(key) || in.is_null(key)) return std::nullopt;
      return in.text(key, {.least = 1, .most = 255});
    };
    job.elevation = name("elevation"), job.camera = name("camera"), job.key = name("key");
    job.vectors = name("vectors");
    if (in.has("tile_format")) job.tile_format = in.choice("tile_format", {"jpeg", "webp", "png"});
    if (in.has("container")) job.container = in.choice("container", {"mbtiles", "cog"});
    job.quality = in.optional_integer<int>("quality", 1, 100).value_or(job.quality);
    in.finish();
    return job;
  } catch (const JsonError& error) {
    return invalid(error.pointer() + ": expected " + error.text().expected + ", found " + error.text().found);
  } catch (const Error& error) {
    return invalid(error.text().what + ": " + error.text().found);
  }
}

ApiResponse start_job(const ApiRequest& request, PlanningRoom& room, const StoredMission& mission) {
  const auto job = parse_job(request);
  if (const auto* problem = std::get_if<Problem>(&job)) return answer(*problem);
  room.start(mission, std::get<JobRequest>(job));
  return json_answer(201, room.jobs().latest(mission.id));
}

ApiResponse file_of(const ApiRequest& request, const PlanningRoom& room, const StoredMission& mission) {
  const auto query = parse_query(request.target);
  const auto format = query ? query->find("format") : std::map<std::string, std::string>::const_iterator{};
  if (!query || query->size() != 1 || format == query->end()) {
    return answer(
        {.status = 400, .type = "query", .detail = "?format is yaml, plan, waypoints, kml, kmz, geojson or gpkg"});
  }
  const Bytes bytes = room.exported(mission, format->second);
  ApiResponse response{.content_type = "application/octet-stream", .body = std::string(as_text(bytes))};
  response.headers.emplace_back("Content-Disposition", fmt::format("attachment; filename=\"{}.{}\"",
                                                                   mission.reading.mission->id, format->second));
  return without_cache(std::move(response));
}

json sample_json(const ProfileSample& sample) {
  const auto number = [](const std::optional<double>& value) { return value ? json(*value) : json(); };
  return {{"at_m", sample.at_m},
          {"lon_deg", sample.place.lon_deg},
          {"lat_deg", sample.place.lat_deg},
          {"ground_m", number(sample.ground_m)},
          {"height_m", number(sample.height_m)},
          {"agl_m", number(sample.agl_m)},
          {"width_m", sample.width_m},
          {"length_m", sample.length_m}};
}

ApiResponse profile_answer(const ApiRequest& request, const PlanningRoom& room, const StoredMission& mission) {
  auto query = parse_query(request.target);
  std::optional<std::string> elevation, camera;
  if (query) {
    if (auto found = query->extract("elevation"); !found.empty()) elevation = std::move(found.mapped());
    if (auto found = query->extract("camera"); !found.empty()) camera = std::move(found.mapped());
  }
  if (!query || !query->empty()) {
    return answer({.status = 400, .type = "query", .detail = "?elevation and ?camera are names of sources"});
  }
  const PlanningRoom::Profile profile = room.profile(mission, elevation, camera);
  json samples = json::array(), points = json::array();
  for (const ProfileSample& sample : profile.profile.samples) samples.push_back(sample_json(sample));
  for (const double at_m : profile.profile.points_m) points.push_back({{"at_m", at_m}});
  return without_cache(
      json_answer(200, {{"samples", std::move(samples)}, {"points", std::move(points)}, {"ground", profile.ground}}));
}

ApiResponse geojson_answer(std::string body) {
  return without_cache({.content_type = "application/geo+json", .body = std::move(body)});
}

ApiResponse layer(const DeskRoute& route, const PlanningRoom& room, const StoredMission& mission, UtcTime now) {
  if (route.tile == "prediction") {
    auto prediction = room.prediction(mission);
    if (!prediction) return unknown("layer", "nothing was predicted yet: run the step \"predict\"");
    return geojson_answer(*std::move(prediction));
  }
  if (route.tile == "imagery") {
    if (!mission.reading.mission) return unknown("layer", "the mission is not complete yet");
    return geojson_answer(
        imagery_coverage_geojson(*mission.reading.mission, room.sources(), now, kMostImageryTiles).dump());
  }
  const std::shared_ptr<const PlannedPackage> package = room.package(mission);
  if (!package) return unknown("package", "the mission has no package yet");
  if (route.tile == "vectors") return vectors_answer(vectors_of(*package));
  if (route.tile == "tiles") return geojson_answer(tiles_geojson(*package, now, kMostTiles).dump());
  return geojson_answer(gaps_geojson(*package, *mission.reading.mission).dump());
}

ApiResponse remove_package(DeskService& desk, const StoredMission& mission) {
  PlanningRoom& room = desk.planning();
  const auto name = room.package_name(mission);
  if (!name || !room.package(mission)) return unknown("package", "the mission has no package");
  const std::vector<FlightSummary> flights = desk.list();
  const auto flown = std::find_if(flights.begin(), flights.end(),
                                  [&](const FlightSummary& flight) { return flight.package == *name; });
  if (flown != flights.end()) {
    throw PlanningConflict({.what = "a flight of this desk is placed on the package", .found = flown->name});
  }
  room.remove_package(mission);
  return {.status = 204, .content_type = {}};
}

ApiResponse call_of_mission(const DeskRoute& route, const ApiRequest& request, DeskService& desk) {
  PlanningRoom& room = desk.planning();
  const auto mission = room.missions().find(route.name);
  if (!mission) return unknown("mission", "there is no mission of this id");
  switch (route.path) {
    case DeskPath::mission:
      if (request.method == "PUT") return write_mission(request, room, *mission);
      if (request.method != "DELETE") return without_cache(json_answer(200, mission_json(room, *mission)));
      room.remove(mission->id);
      return {.status = 204, .content_type = {}};
    case DeskPath::mission_package: return remove_package(desk, *mission);
    case DeskPath::mission_file: return file_of(request, room, *mission);
    case DeskPath::mission_profile: return profile_answer(request, room, *mission);
    case DeskPath::mission_layer: return layer(route, room, *mission, desk.judged_at());
    case DeskPath::mission_tile: {
      const std::shared_ptr<const PlannedPackage> package = room.package(*mission);
      return tile_answer(package ? package->tiles.get() : nullptr, route.tile);
    }
    case DeskPath::mission_jobs: return start_job(request, room, *mission);
    default: break;  // mission_job
  }
  if (request.method == "DELETE") room.cancel(mission->id);
  const json job = room.jobs().latest(mission->id);
  if (!job.is_object()) return unknown("job", "nothing was started for this mission yet");
  return without_cache(json_answer(200, job));
}

}  // namespace

bool is_mission_path(DeskPath path) { return path >= DeskPath::planning && path <= DeskPath::mission_package; }

ApiResponse mission_call(const DeskRoute& route, const ApiRequest& request, DeskService& desk) {
  PlanningRoom& room = desk.planning();
  try {
    switch (route.path) {
      case DeskPath::planning: return without_cache(json_answer(200, planning_json(room, desk.judged_at())));
      case DeskPath::imagery_tile: return tile_answer(room.sources().tiles(route.name).get(), route.tile);
      case DeskPath::mission_import: return import_mission(request, room);
      case DeskPath::missions: break;
      default: return call_of_mission(route, request, desk);
    }
    if (request.method == "POST") return create_mission(request, room);
    json list = json::array();
    for (const StoredMission& mission : room.missions().list()) list.push_back(mission_line(room, mission));
    return without_cache(json_answer(200, {{"missions", std::move(list)}}));
  } catch (const RevisionConflict& error) {
    return answer({.status = 409, .type = "changed", .detail = error.text().what + ": " + error.text().fix});
  } catch (const PlanningConflict& error) {
    std::string detail = error.text().what;
    if (!error.text().found.empty()) detail += ": " + error.text().found;
    if (!error.text().fix.empty()) detail += "; " + error.text().fix;
    return answer({.status = 409, .type = "conflict", .detail = std::move(detail)});
  }
}

}  // namespace nadir
