// Requests to the two services: the API of an aircraft and the candidate service.
#include <algorithm>
#include <nlohmann/json.hpp>

#include "api/api.hpp"
#include "api/view_formats.hpp"
#include "base/files.hpp"
#include "candidates/audit_log.hpp"
#include "candidates/installed_store.hpp"
#include "fuzz/scratch.hpp"
#include "fuzz/targets.hpp"
#include "http/access.hpp"
#include "http/multipart.hpp"
#include "nadir_candidates/access_tokens.hpp"
#include "nadir_candidates/upload_api.hpp"
#include "service/acceptance_record.hpp"
#include "service/sealed_text.hpp"
#include "service/service_rules.hpp"

namespace nadir::fuzz {

// What clients send to the service: the bodies of its POSTs, and whole requests.

namespace {

// A service in flight, so that requests without a pose have one.
struct Service {
  Service() {
    FlightView view;
    view.boot_id = "fuzz";
    view.source = SourceLabel::satellite_anchored;
    view.position = PositionView{{8.5, 47.4}, 3, 9, 9, 0};
    view.heading_rad = view.pitch_rad = view.roll_rad = 0.02;
    view.agl_m = 100;
    view.events.push_back({.id = 1, .time_s = 0, .severity = EventSeverity::info, .kind = "state", .text = "normal"});
    board.publish(view);
  }
  FlightBoard board;
  LatestSlot<Hint> hints;
  Api api{board, hints, {.now_s = [] { return 0.0; }, .token = std::nullopt}};
};

Service& service() {
  static Service one;
  return one;
}

nlohmann::json check(const ApiResponse& response) {
  require(response.status != 500, "a request that breaks the service");
  if (response.content_type.find("json") == std::string::npos) return {};
  const nlohmann::json document = nlohmann::json::parse(response.body, nullptr, false);
  require(!document.is_discarded(), "an answer that is no JSON");
  require((response.status >= 400) == (response.content_type == "application/problem+json"),
          "a problem without its media type");
  return document;
}

ApiRequest post(const char* target, std::string_view body) {
  ApiRequest request;
  request.method = "POST";
  request.target = target;
  request.host = "localhost";
  request.content_type = "application/json";
  request.body = body;
  return request;
}

}  // namespace

void api_hint(std::string_view bytes) {
  const ApiResponse response = service().api.handle(post("/v1/hint", bytes));
  check(response);
  const auto hint = service().hints.take();
  require((hint != nullptr) == (response.status == 202), "a refused hint that is handed on, or the reverse");
  if (!hint) return;
  require(hint->place.lat_deg >= -90 && hint->place.lat_deg <= 90, "a latitude that is none");
  require(hint->place.lon_deg >= -180 && hint->place.lon_deg <= 180, "a longitude that is none");
  require(hint->radius_m > 0 && hint->radius_m <= kMaxHintRadius_m, "a radius that is none");
}

void api_object(std::string_view bytes) {
  const ApiResponse response = service().api.handle(post("/v1/object-location", bytes));
  const nlohmann::json document = check(response);
  if (response.status != 200) return;
  for (const char* name : {"lon", "lat", "error_bound_m", "range_m"}) {
    require(document.at(name).is_number(), "a place that is no number");
  }
  require(document.at("error_bound_m").get<double>() >= 0, "a bound below zero");
}

// A recording of a minute.
void api_playback(std::string_view bytes) {
  static FlightBoard board;
  static LatestSlot<Hint> hints;
  static std::optional<PlaybackRequest> asked;
  static const Api api(board, hints,
                       {.now_s = [] { return 0.0; },
                        .control_playback =
                            [](const PlaybackRequest& request) {
                              asked = request;
                              return PlaybackView();
                            }});
  FlightView view;
  view.playback = PlaybackView{.session = "fuzz", .length_s = 60};
  board.publish(view);
  asked.reset();
  const ApiResponse response = api.handle(post("/v1/playback", bytes));
  check(response);
  require(asked.has_value() == (response.status == 200), "a refused request that is followed, or the reverse");
  if (!asked) return;
  require(!asked->at_s || (*asked->at_s >= 0 && *asked->at_s <= 60), "a moment beyond the recording");
  require(!asked->speed || std::ranges::count(kPlaybackSpeeds, *asked->speed) == 1, "a speed that is none");
}

// The first line is the target, the second the host, the third the last event's id.
void api_request(std::string_view bytes) {
  std::string lines[3];
  for (std::string& line : lines) {
    const std::size_t end = std::min(bytes.find('\n'), bytes.size());
    line = bytes.substr(0, end);
    bytes.remove_prefix(std::min(end + 1, bytes.size()));
  }
  ApiRequest request;
  request.method = "GET";
  request.target = lines[0];
  request.host = lines[1];
  check(service().api.handle(request));
  StreamCursor cursor = cursor_from(lines[2]);
  require(!service().api.next_of_stream(cursor).empty(), "a new reader receives nothing");
  require(service().api.next_of_stream(cursor).empty(), "the same event comes twice");
}

// What anyone may send to the candidate service before its token is checked: path, method, headers.

// Lines: method, path, Upload-Offset, Upload-Length, Content-Digest, Content-Type.
void upload_request(std::string_view bytes) {
  const auto line = [&bytes] {
    const std::size_t end = std::min(bytes.find('\n'), bytes.size());
    std::string text(bytes.substr(0, end));
    bytes.remove_prefix(std::min(end + 1, bytes.size()));
    return text;
  };
  ApiRequest request;
  request.method = line(), request.target = line();
  for (const char* name : {"upload-offset", "upload-length", "content-digest"}) request.headers[name] = line();
  const auto route = upload_route(request.target, request.method, 1 << 20);
  require(!route || request.target.starts_with("/v1/"), "a path outside of the API");
  const bool here = names_loopback(request.target);
  require(!here || request.target.find_first_not_of("0123456789.:[]localhostLOCALHOST") == std::string::npos,
          "another host's name");
  require(!route || route->admission.upload.find('/') == std::string::npos, "an upload's name that is a path");
  if (route) route->allows(request.method);
  const auto header = part_header(request);
  if (const auto* part = std::get_if<PartHeader>(&header)) {
    require(!part->length || *part->length > 48, "a pack that holds no tile");
  }
  media_type(line());
}

void acceptance(std::string_view bytes) {
  const AcceptanceReading reading = parse_acceptance(sealed(std::string(bytes)));
  require(reading.record.has_value() == reading.rejection.empty(), "a record and a reason against it, or neither");
  if (!reading.record) return;
  require(parse_acceptance(to_text(*reading.record)).record == reading.record, "a record changes when it is written");
}

// What an aircraft that somebody may have had in his hands reports, and the service's own record on a damaged disk.
void installed(std::string_view bytes) {
  refusing([&] {
    const SignedInstalledReport read = parse_installed_report(bytes, "fuzz");
    require(parse_installed_report(read.json(), "fuzz").json() == read.json(), "a report changes when it is written");
    require(read.report.airframe.find('/') == std::string::npos && !read.report.airframe.starts_with('.'),
            "an airframe that is a path");
    require(next_report_number(std::string(bytes), UtcTime()) > read.report.number ||
                read.report.number == std::int64_t{1} << 53,
            "a number that does not go on");
  });
  refusing([&] {
    const InstalledRecord record = parse_installed_record(bytes, "fuzz");
    require(record.highest_sequence >= 0, "a sequence below zero");
  });
}

void tokens(std::string_view bytes) {
  refusing([&] {
    const std::vector<AccessToken> read = parse_tokens(bytes, "fuzz");
    const std::string written = tokens_json(read);
    require(tokens_json(parse_tokens(written, "fuzz")) == written, "tokens change when they are written");
    for (const AccessToken& token : read) require(!token.scopes.empty() && token.expires, "a token without bounds");
  });
}

void audit(std::string_view bytes) {
  const std::filesystem::path folder = scratch_folder() / "audit";
  std::filesystem::remove_all(folder);
  const FixedClock clock(UtcTime{1'795'000'000});
  const std::string text(bytes);
  {
    AuditLog log(folder, clock);
    log.record(
        {.act = text, .result = text, .token = text, .client = text, .key = text, .subject = text, .detail = text});
  }
  const std::string line = read_text_file(folder / "audit.jsonl");
  require(line.find('\n') == line.size() - 1, "a caller's line");
  require(nlohmann::json::parse(line).at("n") == 1, "a line that is no JSON");
  scratch_file("audit/audit.jsonl", bytes);  // and a log that was damaged: it goes on
  AuditLog(folder, clock).record({.act = "next", .result = "done"});
  const std::string damaged = read_text_file(folder / "audit.jsonl");
  const std::size_t end = damaged.rfind('\n', damaged.size() - 2);
  const std::string last = damaged.substr(end == std::string::npos ? 0 : end + 1);
  require(nlohmann::json::parse(last).at("act") == "next", "a damaged log swallows the next line");
}

void multipart(std::string_view bytes) {
  const std::size_t line = std::min(bytes.find('\n'), bytes.size());
  const std::string_view type = bytes.substr(0, line), body = bytes.substr(std::min(line + 1, bytes.size()));
  const auto parts = parse_multipart(type, body, 5);
  require(!parts || parts->size() <= 5, "more parts than there may be");
  std::size_t inside = 0;
  for (std::size_t i = 0; parts && i < parts->size(); ++i) inside += (*parts)[i].bytes.size();
  require(inside <= body.size(), "parts that overlap");
  parse_query(bytes);
  path_parts(bytes);
}

}  // namespace nadir::fuzz
