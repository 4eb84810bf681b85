#include "desk/desk_annotations.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <nlohmann/json.hpp>
#include <utility>

#include "base/csv.hpp"
#include "base/error.hpp"
#include "base/printable.hpp"
#include "geodesy/angles.hpp"
#include "geodesy/hypotenuse.hpp"
#include "http/json_body.hpp"
#include "http/multipart.hpp"

namespace nadir {
namespace {

using nlohmann::json;

// Of the way since the frame that a person looked at: odometry's drift, and the speed of what it did not see. Chosen.
constexpr double kDriftShare = 0.05;
constexpr double kUnknownSpeed_mps = 40;
constexpr double kMaxPixelFixSigma_m = 1000;  // beyond it a place with a radius says the same

constexpr NumberRange kFixLat{.low = -90, .high = 90}, kFixLon{.low = -180, .high = 180};
constexpr NumberRange kPixel{.low = -0.5, .high = 100'000};
constexpr int kMaxFrame = std::numeric_limits<int>::max();

json json_number(double value) { return std::isfinite(value) ? json(value) : json(); }

ApiResponse no_such(const char* type, const char* detail) {
  return answer({.status = 404, .type = type, .detail = detail});
}

std::optional<PixelPoint> optional_pixel(BodyFields& body) {
  auto fields = body.optional_object("pixel");
  if (!fields) return std::nullopt;
  const double x = fields->number("x", kPixel), y = fields->number("y", kPixel);
  fields->finish();
  return PixelPoint{.x = x, .y = y};
}

std::string author(BodyFields& body) {
  return body.optional_text("by", {.least = 1, .most = 100}).value_or("operator");
}

std::size_t frame_in(BodyFields& body) { return static_cast<std::size_t>(body.integer("frame", 0, kMaxFrame)); }

// What a person found in the picture of a frame: {"frame", "pixel"}.
MarkedSighting sighting_in(BodyFields& body, FieldErrors& errors) {
  MarkedSighting sighting{.frame = frame_in(body)};
  const auto pixel = optional_pixel(body);
  if (!pixel && errors.empty()) errors.push_back({"/pixel", "is missing"});
  sighting.pixel = pixel.value_or(PixelPoint{});
  return sighting;
}

void check_processed(const FlightStore& store, std::size_t frame) {
  if (frame < store.processed()) return;
  throw UsageError({.what = "the frame has not been processed",
                    .expected = fmt::format("a frame before {}", store.processed()),
                    .found = fmt::format("frame {}", frame)});
}

void check_in_picture(const FlightStore& store, std::size_t frame, const PixelPoint& pixel) {
  check_processed(store, frame);
  const CameraModel& camera = store.description().session.camera.camera;
  if (pixel.x <= camera.width - 0.5 && pixel.y <= camera.height - 0.5) return;
  throw UsageError({.what = "the pixel is outside of the picture",
                    .expected = fmt::format("within {} × {} pixels", camera.width, camera.height),
                    .found = fmt::format("({:.1f}, {:.1f})", pixel.x, pixel.y)});
}

// ---- Fixes

json fix_json(const UserFix& fix) {
  const auto place = [](const LonLat& at) {
    return json{{"lon", json_number(at.lon_deg)}, {"lat", json_number(at.lat_deg)}};
  };
  json document = place(fix.place);
  document["id"] = fix.id;
  document["before_frame"] = fix.before_frame;
  document["radius_m"] = json_number(fix.radius_m);
  document["sigma_m"] = json_number(fix.sigma_m);
  document["frame"] = fix.frame ? json(*fix.frame) : json();
  document["pixel"] = fix.pixel ? json{{"x", json_number(fix.pixel->x)}, {"y", json_number(fix.pixel->y)}} : json();
  document["hint"] = place(fix.hint.place);
  document["hint"]["radius_m"] = json_number(fix.hint.radius_m);
  document["by"] = printable(fix.by);
  document["time"] = to_rfc3339(fix.time);
  document["withdrawn"] = fix.withdrawn ? json(to_rfc3339(*fix.withdrawn)) : json();
  return document;
}

std::variant<UserFix, Problem> parse_fix(const ApiRequest& request) {
  return read_body<UserFix>(request, [](BodyFields& body, FieldErrors& errors) {
    UserFix fix;
    fix.place.lat_deg = body.number("lat", kFixLat);
    fix.place.lon_deg = body.number("lon", kFixLon);
    if (const auto frame = body.optional_integer("frame", 0, kMaxFrame)) fix.frame = static_cast<std::size_t>(*frame);
    fix.pixel = optional_pixel(body);
    if (fix.pixel) {
      const NumberRange sigmas{.low = 0, .high = kMaxPixelFixSigma_m, .above_low = true};
      fix.sigma_m = body.optional_number("sigma_m", sigmas).value_or(kPixelFixSigma_m);
      fix.radius_m = kHintRadiusSigmas * fix.sigma_m;
      if (!fix.frame && errors.empty()) errors.push_back({"/frame", "is missing: whose picture shows the pixel"});
    } else {
      fix.radius_m = body.number("radius_m", {.low = 0, .high = kMaxFixRadius_m, .above_low = true});
      fix.sigma_m = fix.radius_m / kHintRadiusSigmas;
    }
    fix.by = author(body);
    return fix;
  });
}

ApiResponse add_fix(const ApiRequest& request, LiveFlight& flight, const FlightGround& ground) {
  auto parsed = parse_fix(request);
  if (const auto* problem = std::get_if<Problem>(&parsed)) return answer(*problem);
  UserFix& fix = std::get<UserFix>(parsed);
  const FlightStore& store = flight.store();
  fix.hint = {fix.place, fix.radius_m};
  if (fix.pixel) {
    check_in_picture(store, *fix.frame, *fix.pixel);
    const auto aircraft = aircraft_at(view_of(store, ground, *fix.frame), *fix.pixel, fix.place, fix.sigma_m);
    if (!aircraft) {
      throw UsageError({.what = "this pixel shows no ground by the attitude that was measured",
                        .expected = "a point on the ground",
                        .fix = "choose a point nearer to the middle of the picture"});
    }
    fix.hint = *aircraft;
  }
  if (fix.frame) fix.hint = carried_to_the_present(fix.hint, *fix.frame, store);
  return without_cache(json_answer(201, fix_json(flight.add_fix(fix))));
}

ApiResponse withdraw_fix(const DeskRoute& route, LiveFlight& flight) {
  const auto fix = flight.withdraw_fix(route.item);
  if (!fix) return no_such("fix", "the flight has no fix of this number");
  return without_cache(json_answer(200, fix_json(*fix)));
}

// ---- Objects

json object_json(const MarkedObject& object, const FlightStore& store, const FlightGround& ground) {
  json document{{"id", object.id},
                {"name", printable(object.name)},
                {"by", printable(object.by)},
                {"time", to_rfc3339(object.time)},
                {"sightings", json::array()},
                {"place", nullptr},
                {"reason", nullptr}};
  const auto found = place_of(object, store, ground);
  const auto* placed = std::get_if<PlacedObject>(&found);
  for (std::size_t i = 0; i < object.sightings.size(); ++i) {
    const MarkedSighting& sighting = object.sightings[i];
    document["sightings"].push_back(
        {{"id", sighting.id},
         {"frame", sighting.frame},
         {"pixel", {{"x", json_number(sighting.pixel.x)}, {"y", json_number(sighting.pixel.y)}}},
         {"residual_px", placed ? json_number(placed->located.residual_px.at(i).norm()) : json()}});
  }
  if (!placed) {
    document["reason"] = std::get<std::string>(found);
    return document;
  }
  const LocatedObject& located = placed->located;
  document["place"] = {{"lat", json_number(placed->place.lat_deg)},
                       {"lon", json_number(placed->place.lon_deg)},
                       {"height_m", json_number(placed->height_m)},
                       {"ellipse_95",
                        {{"major_m", json_number(located.ellipse_95.major_m)},
                         {"minor_m", json_number(located.ellipse_95.minor_m)},
                         {"bearing_deg", json_number(located.ellipse_95.bearing_deg)}}},
                       {"adjusted", placed->adjusted},
                       {"agrees", located.agrees},
                       {"worst", located.worst ? json(object.sightings.at(*located.worst).id) : json()}};
  return document;
}

json objects_json(const FlightStore& store, const FlightGround& ground) {
  json list = json::array();
  for (const MarkedObject& object : store.objects()) list.push_back(object_json(object, store, ground));
  return list;
}

std::string objects_geojson(const json& objects) {
  json features = json::array();
  for (const json& object : objects) {
    const json& place = object["place"];
    json properties{{"id", object["id"]},     {"name", object["name"]},     {"by", object["by"]},
                    {"time", object["time"]}, {"reason", object["reason"]}, {"sightings", object["sightings"].size()}};
    json geometry;
    if (!place.is_null()) {
      geometry = {{"type", "Point"}, {"coordinates", {place["lon"], place["lat"]}}};
      for (const char* name : {"height_m", "agrees"}) properties[name] = place[name];
      for (const auto& [name, value] : place["ellipse_95"].items()) properties["ellipse_95_" + name] = value;
    }
    features.push_back({{"type", "Feature"}, {"geometry", geometry}, {"properties", properties}});
  }
  return json{{"type", "FeatureCollection"}, {"features", features}}.dump();
}

std::string objects_csv(const json& objects) {
  std::string text =
      "id,name,lat_deg,lon_deg,height_m,ellipse_95_major_m,ellipse_95_minor_m,ellipse_95_bearing_deg,agrees,sightings,"
      "time\n";
  for (const json& object : objects) {
    const json& place = object["place"];
    text +=
        fmt::format("{},{},", object["id"].get<std::int64_t>(), spreadsheet_cell(object["name"].get<std::string>()));
    if (place.is_null()) {
      text += ",,,,,,,";
    } else {
      const json& ellipse = place["ellipse_95"];
      text += fmt::format("{:.8f},{:.8f},{:.2f},{:.2f},{:.2f},{:.1f},{},", place["lat"].get<double>(),
                          place["lon"].get<double>(), place["height_m"].get<double>(), ellipse["major_m"].get<double>(),
                          ellipse["minor_m"].get<double>(), ellipse["bearing_deg"].get<double>(),
                          place["agrees"].get<bool>());
    }
    text += fmt::format("{},{}\n", object["sightings"].size(), object["time"].get<std::string>());
  }
  return text;
}

ApiResponse list_objects(const ApiRequest& request, const LiveFlight& flight, const FlightGround& ground) {
  auto query = parse_query(request.target);
  std::string format = "json";
  if (query) {
    if (auto found = query->extract("format"); !found.empty()) format = found.mapped();
  }
  if (!query || !query->empty() || (format != "json" && format != "geojson" && format != "csv")) {
    return answer({.status = 400, .type = "query", .detail = "?format is json, geojson or csv"});
  }
  const json objects = objects_json(flight.store(), ground);
  if (format == "json") return without_cache(json_answer(200, {{"objects", objects}}));
  ApiResponse response{.content_type = format == "csv" ? "text/csv; charset=utf-8" : "application/geo+json",
                       .body = format == "csv" ? objects_csv(objects) : objects_geojson(objects),
                       .headers = {{"Cache-Control", "no-store"}}};
  response.headers.emplace_back("Content-Disposition",
                                fmt::format("attachment; filename=\"{}-objects.{}\"", flight.id(), format));
  return response;
}

ApiResponse add_object(const ApiRequest& request, LiveFlight& flight, const FlightGround& ground) {
  struct NewObject {
    MarkedSighting first;
    std::string name, by;
  };
  auto parsed = read_body<NewObject>(request, [](BodyFields& body, FieldErrors& errors) {
    NewObject object{.first = sighting_in(body, errors), .name = {}, .by = {}};
    object.name = body.optional_text("name", {.least = 0, .most = kMaxObjectName}).value_or(std::string());
    object.by = author(body);
    return object;
  });
  if (const auto* problem = std::get_if<Problem>(&parsed)) return answer(*problem);
  const NewObject& object = std::get<NewObject>(parsed);
  check_in_picture(flight.store(), object.first.frame, object.first.pixel);
  const MarkedObject added = flight.add_object(object.name, object.first, object.by);
  return without_cache(json_answer(201, object_json(added, flight.store(), ground)));
}

ApiResponse add_sighting(const DeskRoute& route, const ApiRequest& request, LiveFlight& flight,
                         const FlightGround& ground) {
  auto parsed = read_body<MarkedSighting>(request, sighting_in);
  if (const auto* problem = std::get_if<Problem>(&parsed)) return answer(*problem);
  const MarkedSighting& sighting = std::get<MarkedSighting>(parsed);
  check_in_picture(flight.store(), sighting.frame, sighting.pixel);
  const auto object = flight.add_sighting(route.item, sighting);
  if (!object) return no_such("object", "the flight has no object of this number");
  return without_cache(json_answer(201, object_json(*object, flight.store(), ground)));
}

ApiResponse object_call(const DeskRoute& route, const ApiRequest& request, LiveFlight& flight,
                        const FlightGround& ground) {
  std::optional<MarkedObject> object;
  if (request.method == "DELETE") {
    if (!flight.remove_object(route.item)) return no_such("object", "the flight has no object of this number");
    return without_cache(json_answer(200, {{"removed", route.item}}));
  }
  if (request.method == "PATCH") {
    auto parsed = read_body<std::string>(request, [](BodyFields& body, FieldErrors& /*errors*/) {
      return body.text("name", {.least = 0, .most = kMaxObjectName});
    });
    if (const auto* problem = std::get_if<Problem>(&parsed)) return answer(*problem);
    object = flight.rename_object(route.item, std::get<std::string>(parsed));
  } else {
    object = flight.store().object(route.item);
  }
  if (!object) return no_such("object", "the flight has no object of this number");
  return without_cache(json_answer(200, object_json(*object, flight.store(), ground)));
}

ApiResponse remove_sighting(const DeskRoute& route, LiveFlight& flight, const FlightGround& ground) {
  if (!flight.remove_sighting(route.item, route.part)) {
    return no_such("sighting", "the object has no sighting of this number");
  }
  const auto object = flight.store().object(route.item);
  if (!object) return no_such("object", "the flight has no object of this number");
  return without_cache(json_answer(200, object_json(*object, flight.store(), ground)));
}

// ---- The footprint

ApiResponse footprint_call(const DeskRoute& route, const FlightStore& store, const FlightGround& ground) {
  if (route.frame >= store.processed()) return no_such("frame", "no processed frame has this number");
  const CameraModel& camera = store.description().session.camera.camera;
  const FrameView view = view_of(store, ground, route.frame);
  json document{{"frame", route.frame},
                {"position", nullptr},
                {"heading_deg", json_number(degrees(view.camera.pose.attitude.heading_rad))},
                {"heading_sigma_deg", json_number(degrees(view.heading_sigma_rad))},
                {"agl_m", json_number(view.camera.pose.agl_m)},
                {"adjusted", view.adjusted},
                {"picture", {{"width", camera.width}, {"height", camera.height}}},
                {"corners", nullptr}};
  if (view.placed) {
    const LonLat at = ground.plane().lonlat_from_plane(view.camera.pose.position);
    document["position"] = {{"lat", json_number(at.lat_deg)}, {"lon", json_number(at.lon_deg)}};
  }
  if (const auto corners = footprint(view)) {
    document["corners"] = json::array();
    for (const Eigen::Vector2d& corner : *corners)
      document["corners"].push_back({json_number(corner.x()), json_number(corner.y())});
  }
  return without_cache(json_answer(200, document));
}

}  // namespace

SearchHint carried_to_the_present(SearchHint hint, std::size_t frame, const FlightStore& store) {
  check_processed(store, frame);
  const std::vector<Estimate> since = store.estimates(EstimateKind::online, frame);
  const Estimate &then = since.front(), &now = since.back();
  if (then.position && now.position && then.segment == now.segment) {
    const PlanePoint way = LocalFrame(*then.position).plane_from_lonlat(*now.position);
    hint.place = LocalFrame(hint.place).lonlat_from_plane(way);
    hint.radius_m += kDriftShare * hypotenuse(way.east_m, way.north_m);
  } else {
    hint.radius_m += kUnknownSpeed_mps * std::max(0.0, now.time_s - then.time_s);
  }
  hint.radius_m = std::min(hint.radius_m, kMaxFixRadius_m);
  return hint;
}

ApiResponse annotation_call(const DeskRoute& route, const ApiRequest& request, LiveFlight& flight,
                            const FlightGround& ground) {
  switch (route.path) {
    case DeskPath::fixes: {
      if (request.method == "POST") return add_fix(request, flight, ground);
      json list = json::array();
      for (const UserFix& fix : flight.store().fixes()) list.push_back(fix_json(fix));
      return without_cache(json_answer(200, {{"fixes", std::move(list)}}));
    }
    case DeskPath::fix: return withdraw_fix(route, flight);
    case DeskPath::objects:
      return request.method == "POST" ? add_object(request, flight, ground) : list_objects(request, flight, ground);
    case DeskPath::object: return object_call(route, request, flight, ground);
    case DeskPath::sightings: return add_sighting(route, request, flight, ground);
    case DeskPath::sighting: return remove_sighting(route, flight, ground);
    default: return footprint_call(route, flight.store(), ground);
  }
}

}  // namespace nadir
