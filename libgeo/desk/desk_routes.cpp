#include "desk/desk_routes.hpp"

#include <fmt/format.h>

#include <array>
#include <utility>
#include <vector>

#include "base/number_text.hpp"
#include "http/multipart.hpp"

namespace nadir {
namespace {

constexpr std::string_view kJson = "application/json";
constexpr std::string_view kPictureMedia = "multipart/form-data image/jpeg image/png image/webp";

bool lists(std::string_view list, std::string_view word, char separator) {
  for (std::size_t at = list.find(word); at != std::string_view::npos; at = list.find(word, at + 1)) {
    const std::size_t end = at + word.size();
    if ((at == 0 || list[at - 1] == ' ') && (end == list.size() || list[end] == separator)) return !word.empty();
  }
  return false;
}

bool has_body(std::string_view method) { return method == "POST" || method == "PATCH" || method == "PUT"; }

// A path that takes JSON beside other methods.
DeskRoute with_json(DeskRoute route, DeskPath path, std::string_view methods, std::string_view method) {
  route.path = path, route.methods = methods;
  if (has_body(method)) route.media = kJson, route.body_max = kMaxJsonBody;
  return route;
}

// …/WHAT of a flight.
std::optional<DeskRoute> list_route(DeskRoute route, std::string_view what, std::string_view method,
                                    std::uint64_t picture_bytes) {
  static constexpr std::array<std::pair<std::string_view, DeskPath>, 4> kPlain{{{"events", DeskPath::events},
                                                                                {"estimates", DeskPath::estimates},
                                                                                {"segments", DeskPath::segments},
                                                                                {"export", DeskPath::export_track}}};
  if (what == "pictures") {
    route.path = DeskPath::pictures, route.methods = "POST";
    route.media = kPictureMedia, route.body_max = picture_bytes;
    return route;
  }
  if (what == "fixes") return with_json(std::move(route), DeskPath::fixes, "GET, HEAD, POST", method);
  if (what == "objects") return with_json(std::move(route), DeskPath::objects, "GET, HEAD, POST", method);
  if (what == "complete") {
    route.path = DeskPath::complete, route.methods = "POST";
    return route;
  }
  for (const auto& [name, path] : kPlain) {
    if (what != name) continue;
    route.path = path;
    return route;
  }
  return std::nullopt;
}

// …/objects/NUMBER, and its sightings.
std::optional<DeskRoute> object_route(DeskRoute route, const std::vector<std::string>& parts, std::string_view method) {
  if (parts.size() == 5) return with_json(std::move(route), DeskPath::object, "GET, HEAD, PATCH, DELETE", method);
  if (parts[5] != "sightings") return std::nullopt;
  if (parts.size() == 6) return with_json(std::move(route), DeskPath::sightings, "POST", method);
  const auto part = index_from(parts[6]);
  if (!part || parts.size() > 7) return std::nullopt;
  route.path = DeskPath::sighting, route.methods = "DELETE";
  route.part = static_cast<std::int64_t>(*part);
  return route;
}

std::optional<DeskRoute> flight_route(const std::vector<std::string>& parts, std::string_view method,
                                      std::uint64_t picture_bytes) {
  DeskRoute route{.path = DeskPath::flight, .name = parts[2]};
  if (parts.size() == 3) return route;
  const std::string& what = parts[3];
  if (parts.size() == 4) return list_route(std::move(route), what, method, picture_bytes);
  const auto number = index_from(parts[4]);
  if (!number) return std::nullopt;
  route.frame = *number;
  route.item = static_cast<std::int64_t>(*number);
  if (what == "objects") return object_route(std::move(route), parts, method);
  if (parts.size() == 5 && what == "pictures") {
    route.path = DeskPath::picture;
  } else if (parts.size() == 5 && what == "fixes") {
    route.path = DeskPath::fix, route.methods = "DELETE";
  } else if (parts.size() == 6 && what == "segments" && parts[5] == "merge") {
    route.path = DeskPath::merge, route.methods = "DELETE";
  } else if (parts.size() == 5 && what == "looks") {
    route.path = DeskPath::look;
  } else if (parts.size() == 6 && what == "looks" && (parts[5] == "seen" || parts[5] == "map")) {
    route.path = parts[5] == "seen" ? DeskPath::seen : DeskPath::map;
  } else if (parts.size() == 6 && what == "pictures" && parts[5] == "footprint") {
    route.path = DeskPath::footprint;
  } else {
    return std::nullopt;
  }
  return route;
}

std::optional<DeskRoute> import_route(const std::vector<std::string>& parts, std::string_view method,
                                      std::uint64_t picture_bytes) {
  DeskRoute route{.path = DeskPath::imports, .methods = "GET, HEAD, POST"};
  if (parts.size() == 2) return route;
  route.name = parts[2];
  route.path = DeskPath::import_item, route.methods = "DELETE";
  if (parts.size() == 3) return route;
  if (parts.size() > 4) return std::nullopt;
  if (parts[3] == "flight") return with_json(std::move(route), DeskPath::import_flight, "POST", method);
  if (parts[3] != "files") return std::nullopt;
  route.path = DeskPath::import_files, route.methods = "POST";
  route.media = "multipart/form-data", route.body_max = picture_bytes;
  return route;
}

std::string tile_address(const std::vector<std::string>& parts, std::size_t from) {
  return fmt::format("{}/{}/{}", parts[from], parts[from + 1], parts[from + 2]);
}

// /v1/missions/…
std::optional<DeskRoute> mission_route(const std::vector<std::string>& parts, std::string_view method) {
  DeskRoute route{.path = DeskPath::missions};
  if (parts.size() == 2) return with_json(std::move(route), DeskPath::missions, "GET, HEAD, POST", method);
  if (parts.size() == 3 && parts[2] == "import") {
    return DeskRoute{.path = DeskPath::mission_import,
                     .methods = "POST",
                     .media = "application/octet-stream",
                     .body_max = kMaxDrawingBody};
  }
  route.name = parts[2];
  if (parts.size() == 3) {
    route = with_json(std::move(route), DeskPath::mission, "GET, HEAD, PUT, DELETE", method);
    if (route.body_max > 0) route.body_max = kMaxMissionBody;
    return route;
  }
  const std::string& what = parts[3];
  const bool alone = parts.size() == 4;
  if (alone && what == "file") {
    route.path = DeskPath::mission_file;
  } else if (alone && what == "profile") {
    route.path = DeskPath::mission_profile;
  } else if (alone && what == "package") {
    route.path = DeskPath::mission_package, route.methods = "DELETE";
  } else if (alone && what == "jobs") {
    return with_json(std::move(route), DeskPath::mission_jobs, "POST", method);
  } else if (parts.size() == 5 && what == "jobs" && parts[4] == "latest") {
    route.path = DeskPath::mission_job, route.methods = "GET, HEAD, DELETE";
  } else if (parts.size() == 5 && what == "layers" &&
             (parts[4] == "tiles" || parts[4] == "gaps" || parts[4] == "prediction" || parts[4] == "vectors" ||
              parts[4] == "imagery")) {
    route.path = DeskPath::mission_layer, route.tile = parts[4];
  } else if (parts.size() == 7 && what == "tiles") {
    route.path = DeskPath::mission_tile, route.tile = tile_address(parts, 4);
  } else {
    return std::nullopt;
  }
  return route;
}

}  // namespace

std::optional<std::size_t> index_from(std::string_view text) {
  const auto number = whole_number<std::uint32_t>(text);
  return number && *number <= 1'000'000'000 ? std::optional<std::size_t>(*number) : std::nullopt;
}

std::optional<DeskRoute> desk_route(std::string_view path, std::string_view method, std::uint64_t picture_bytes) {
  static constexpr std::array<std::pair<std::string_view, DeskPath>, 13> kPlain{{
      {"/", DeskPath::page},
      {"/page.js", DeskPath::script},
      {"/page.css", DeskPath::style},
      {"/leaflet.js", DeskPath::leaflet_script},
      {"/leaflet.css", DeskPath::leaflet_style},
      {"/v1/health", DeskPath::health},
      {"/v1/openapi.json", DeskPath::contract},
      {"/v1/packages", DeskPath::packages},
      {"/missions", DeskPath::missions_page},
      {"/missions.js", DeskPath::missions_script},
      {"/missions.css", DeskPath::missions_style},
      {"/drawing.js", DeskPath::drawing_script},
      {"/v1/planning", DeskPath::planning},
  }};
  for (const auto& [plain, leads_to] : kPlain) {
    if (path == plain) return DeskRoute{.path = leads_to};
  }
  const auto parts = path_parts(path);
  if (!parts || parts->size() < 2 || parts->size() > 7 || parts->front() != "v1") return std::nullopt;
  if ((*parts)[1] == "flights") {
    if (parts->size() > 2) return flight_route(*parts, method, picture_bytes);
    DeskRoute route{.path = DeskPath::flights, .methods = "GET, HEAD, POST"};
    if (method == "POST") route.media = kJson, route.body_max = kMaxJsonBody;
    return route;
  }
  if ((*parts)[1] == "imports") return import_route(*parts, method, picture_bytes);
  if ((*parts)[1] == "missions") return mission_route(*parts, method);
  if (parts->size() == 4 && (*parts)[1] == "packages" && (*parts)[3] == "vectors") {
    return DeskRoute{.path = DeskPath::vectors, .name = (*parts)[2]};
  }
  const bool imagery = (*parts)[1] == "imagery";
  if (parts->size() != 7 || (*parts)[3] != "tiles" || (!imagery && (*parts)[1] != "packages")) return std::nullopt;
  return DeskRoute{
      .path = imagery ? DeskPath::imagery_tile : DeskPath::tile, .name = (*parts)[2], .tile = tile_address(*parts, 4)};
}

std::optional<ApiResponse> refusal(const DeskRoute& route, const ApiRequest& header) {
  if (!lists(route.methods, header.method, ',')) {
    ApiResponse response =
        answer({.status = 405, .type = "method", .detail = fmt::format("this path is called with {}", route.methods)});
    response.headers.emplace_back("Allow", std::string(route.methods));
    return response;
  }
  const bool takes_body = route.body_max > 0 && has_body(header.method);
  if (header.other_encoding || (takes_body && !header.content_length)) {
    return answer({.status = 411, .type = "length", .detail = "send the body as it is, with Content-Length"});
  }
  const std::uint64_t length = header.content_length.value_or(0);
  if (length > (takes_body ? route.body_max : 0)) {
    return answer({.status = 413,
                   .type = "body-too-large",
                   .detail = takes_body ? fmt::format("the body has at most {} bytes", route.body_max)
                                        : "this call has no body"});
  }
  if (takes_body && !lists(route.media, media_type(header.content_type), ' ')) {
    return answer({.status = 415, .type = "media-type", .detail = fmt::format("send one of: {}", route.media)});
  }
  return std::nullopt;
}

std::string lane_of(const DeskRoute& route) {
  switch (route.path) {
    case DeskPath::tile: return "tiles";
    case DeskPath::vectors: return "vectors";
    case DeskPath::imagery_tile: return "imagery " + route.name;
    case DeskPath::planning:
    case DeskPath::missions:
    case DeskPath::mission_import: return "missions";
    case DeskPath::mission_tile: return "mission tiles " + route.name;
    case DeskPath::packages: return "packages";
    case DeskPath::import_files:
    case DeskPath::import_flight:
    case DeskPath::import_item: return "import " + route.name;
    case DeskPath::pictures: return "pictures " + route.name;
    case DeskPath::picture:
    case DeskPath::seen:
    case DeskPath::map: return "images " + route.name;
    default: return "flight " + route.name;
  }
}

}  // namespace nadir
