#include "desk/desk_imports.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <nlohmann/json.hpp>
#include <regex>
#include <utility>
#include <variant>

#include "base/printable.hpp"
#include "desk/desk_documents.hpp"
#include "desk/desk_requests.hpp"
#include "geodesy/angles.hpp"
#include "http/json_body.hpp"
#include "http/multipart.hpp"

namespace nadir {
namespace {

using nlohmann::json;

constexpr std::size_t kMaxParts = 200;

ApiResponse no_import() {
  return answer({.status = 404, .type = "import-unknown", .detail = "there is no import of this id"});
}

struct StatedImport {
  NewFlight flight;
  ImportRequest request;
};

std::variant<StatedImport, Problem> parse_stated(const ApiRequest& request) {
  return read_body<StatedImport>(request, [](BodyFields& body, FieldErrors& /*errors*/) {
    StatedImport stated;
    stated.flight = read_flight_members(body, CameraMember::optional);
    ImportRequest& import = stated.request;
    import.model = body.optional_text("model", {.least = 1, .most = 200}).value_or(std::string());
    import.agl_m = body.optional_number("agl_m", {.low = 1, .high = 20'000});
    import.ground_m = body.optional_number("ground_m", {.low = -500, .high = 9000});
    import.lens.focal_px = body.optional_number("focal_px", {.low = 10, .high = 1'000'000});
    import.lens.focal_mm = body.optional_number("focal_mm", {.low = 0.1, .high = 5000});
    import.lens.sensor_width_mm = body.optional_number("sensor_width_mm", {.low = 0.5, .high = 200});
    import.clock_offset_s = body.optional_number("clock_offset_s", {.low = -1e10, .high = 1e10});
    import.interval_s = body.optional_number("interval_s", {.low = 0.001, .high = 86'400});
    if (const auto zone_h = body.optional_number("zone_h", {.low = -14, .high = 14})) import.zone_s = *zone_h * 3600;
    if (auto mount = body.optional_object("mount")) {
      import.mount = {radians(mount->optional_number("yaw_deg", {.low = -360, .high = 360}).value_or(0)),
                      radians(mount->optional_number("pitch_deg", {.low = -45, .high = 45}).value_or(0)),
                      radians(mount->optional_number("roll_deg", {.low = -45, .high = 45}).value_or(0))};
      mount->finish();
    }
    import.start = stated.flight.start;
    import.truth = body.optional_word("start_from", {"gps"}).has_value();
    return stated;
  });
}

// The command's options, of which the findings speak, as this body's members: "--agl-m" as "agl_m".
std::string as_members(const std::string& text) {
  static const std::regex option("--([a-z][a-z-]*)");
  std::string result;
  auto from = text.cbegin();
  for (std::sregex_iterator at(text.begin(), text.end(), option), end; at != end; ++at) {
    result.append(from, (*at)[0].first);
    std::string name = (*at)[1].str();
    std::replace(name.begin(), name.end(), '-', '_');
    result += name;
    from = (*at)[0].second;
  }
  result.append(from, text.cend());
  return printable(result);
}

json findings_json(const Findings& findings) {
  json list = json::array();
  for (const Finding& finding : findings.items()) {
    // Only the last part of a path: the rest is this machine's.
    const std::string where = std::filesystem::path(finding.where).filename().string();
    list.push_back({{"code", finding.code},
                    {"severity", finding.severity == Severity::note ? "note" : "warning"},
                    {"where", as_members(where)},
                    {"expected", as_members(finding.expected)},
                    {"found", as_members(finding.found)},
                    {"fix", as_members(finding.fix)}});
  }
  return list;
}

ApiResponse missing_answer(const Findings& findings) {
  Problem problem{
      .status = 422,
      .type = "import",
      .detail = "the photos do not say all that a flight needs: state it, and send this again; the files stay"};
  for (const Finding& finding : findings.items()) {
    if (finding.severity != Severity::error) continue;
    problem.errors.push_back({finding.code, fmt::format("expected {}; found {}; {}", as_members(finding.expected),
                                                        as_members(finding.found), as_members(finding.fix))});
  }
  return answer(problem);
}

ApiResponse take_files(const DeskRoute& route, const ApiRequest& request, DeskService& desk) {
  desk.check_space(request.body.size());
  const auto parts = parse_multipart(request.content_type, request.body, kMaxParts);
  const bool wanted = parts && std::all_of(parts->begin(), parts->end(), [](const BodyPart& part) {
                        return part.name == "log" || (part.name == "photo" && !part.filename.empty());
                      });
  if (!wanted || parts->empty()) {
    return answer({.status = 400,
                   .type = "malformed",
                   .detail = fmt::format("the body is multipart/form-data of at most {} parts, \"photo\" with their "
                                         "names and \"log\"",
                                         kMaxParts)});
  }
  json files = json::array();
  for (const BodyPart& part : *parts) {
    const ImportedFile file = part.name == "log"
                                  ? desk.imports().put_log(route.name, as_bytes(part.bytes))
                                  : desk.imports().put_photo(route.name, part.filename, as_bytes(part.bytes));
    json& item = files.emplace_back(json{{"name", file.name}, {"outcome", name_of(file.outcome)}});
    if (!file.reason.empty()) item["reason"] = file.reason;
  }
  return without_cache(json_answer(200, {{"files", std::move(files)}}));
}

ApiResponse make_flight(const DeskRoute& route, const ApiRequest& request, DeskService& desk) {
  auto parsed = parse_stated(request);
  if (const auto* problem = std::get_if<Problem>(&parsed)) return answer(*problem);
  auto& [flight, stated] = std::get<StatedImport>(parsed);
  const FinishedImport finished = desk.finish_import(route.name, std::move(flight), stated);
  if (!finished.flight) return missing_answer(finished.result.findings);
  json found = json::object();
  for (const auto& [name, text] : finished.result.figures) found[name] = printable(text);
  json document{{"flight", flight_json(desk.summary(*finished.flight), finished.flight->store())},
                {"found", std::move(found)},
                {"findings", findings_json(finished.result.findings)},
                {"pictures", answers_json(finished.answers)}};
  ApiResponse response = without_cache(json_answer(201, document));
  response.headers.emplace_back("Location", "/v1/flights/" + finished.flight->id());
  return response;
}

}  // namespace

ApiResponse import_call(const DeskRoute& route, const ApiRequest& request, DeskService& desk) {
  if (route.path == DeskPath::imports) {
    if (request.method == "POST") return without_cache(json_answer(201, {{"id", desk.imports().begin()}}));
    json list = json::array();
    for (const StoredImport& one : desk.imports().list()) {
      list.push_back({{"id", one.id}, {"photos", one.photos}, {"bytes", one.bytes}, {"log", one.log}});
    }
    return without_cache(json_answer(200, {{"imports", std::move(list)}}));
  }
  if (!desk.imports().known(route.name)) return no_import();
  if (route.path == DeskPath::import_files) return take_files(route, request, desk);
  if (route.path == DeskPath::import_flight) return make_flight(route, request, desk);
  desk.imports().remove(route.name);
  return {.status = 204, .content_type = ""};
}

}  // namespace nadir
