#include "api/api.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <exception>
#include <nlohmann/json.hpp>

#include "api/page.hpp"
#include "api/requests.hpp"
#include "api/view_formats.hpp"
#include "base/platform.hpp"
#include "http/access.hpp"
#include "http/message.hpp"
#include "map_page/map_page.hpp"
#include "service/service_rules.hpp"

namespace nadir {
namespace {

constexpr std::string_view kTiles = "/v1/tiles/";
constexpr std::array kReadPaths{
    std::string_view("/v1/health"),   std::string_view("/v1/state"),  std::string_view("/v1/package"),
    std::string_view("/v1/metrics"),  std::string_view("/v1/events"), std::string_view("/"),
    std::string_view("/page.css"),    std::string_view("/page.js"),   std::string_view("/leaflet.js"),
    std::string_view("/leaflet.css"), std::string_view("/v1/vectors")};
constexpr std::array kWritePaths{std::string_view("/v1/hint"), std::string_view("/v1/object-location"),
                                 std::string_view("/v1/playback")};

template <typename List>
bool holds(const List& list, std::string_view path) {
  return std::find(list.begin(), list.end(), path) != list.end();
}

}  // namespace

Api::Api(const FlightBoard& board, LatestSlot<Hint>& hints, ApiOptions options)
    : board_(board), hints_(hints), options_(std::move(options)) {}

void Api::use_package(ApiPackage package) {
  auto shared = std::make_shared<const ApiPackage>(std::move(package));
  const std::lock_guard lock(package_mutex_);
  package_ = std::move(shared);
}

std::shared_ptr<const ApiPackage> Api::package() const {
  const std::lock_guard lock(package_mutex_);
  return package_;
}

double Api::age_s(const FlightView& view) const { return std::max(0.0, options_.now_s() - view.time_s); }

std::string Api::next_of_stream(StreamCursor& cursor) const {
  const auto view = board_.snapshot();
  return stream_text(*view, age_s(*view), cursor);
}

void Api::on_thread_start() const { begin_thread("api", ThreadPriority::low); }

void Api::serve(ApiRequest request, const HttpAdmission&, const ServerCounts& counts, Respond respond) const {
  respond(handle(request, counts));
}

ApiResponse Api::handle(const ApiRequest& request, const ServerCounts& server) const {
  try {
    ApiResponse response = route(request, server);
    response.headers.emplace_back("X-Content-Type-Options", "nosniff");
    return response;
  } catch (const std::exception& error) {
    return answer({.status = 500, .type = "internal", .detail = error.what()});
  }
}

std::optional<Problem> Api::access(const ApiRequest& request, std::string_view path) const {
  const bool hints = path == "/v1/hint" && request.method == "POST";
  if (options_.token || !hints) return access_problem(request, options_.loopback, options_.token);
  auto problem = access_problem(request, options_.loopback, options_.hint_token);
  if (problem && problem->status == 401) {
    problem->detail =
        "a hint needs Authorization: Bearer TOKEN, with the token of the file api-token in the service's state folder";
  }
  return problem;
}

ApiResponse Api::route(const ApiRequest& request, const ServerCounts& server) const {
  const std::string_view path = request.path();
  if (auto problem = access(request, path)) {
    ApiResponse refusal = answer(*problem);
    if (problem->status == 401) refusal.headers.emplace_back("WWW-Authenticate", "Bearer");
    return refusal;
  }
  const bool reads = holds(kReadPaths, path) || path.starts_with(kTiles), writes = holds(kWritePaths, path);
  if (!reads && !writes)
    return answer({.status = 404, .type = "path", .detail = "there is no such path; see docs/api.md"});
  if (reads && request.method != "GET" && request.method != "HEAD") {
    ApiResponse refusal = answer({.status = 405, .type = "method", .detail = "this path is read with GET"});
    refusal.headers.emplace_back("Allow", "GET, HEAD");
    return refusal;
  }
  if (writes && request.method != "POST") {
    ApiResponse refusal = answer({.status = 405, .type = "method", .detail = "this path takes POST"});
    refusal.headers.emplace_back("Allow", "POST");
    return refusal;
  }

  if (path == "/v1/health") return health();
  if (path == "/v1/state") return state();
  if (path == "/v1/package") return json_answer(200, package_json(board_.snapshot()->package));
  if (path == "/v1/events") {
    const std::string* const last_event_id = request.header("last-event-id");
    return {.content_type = "text/event-stream",
            .headers = {{"Cache-Control", "no-store"}},
            .stream = [this, cursor = cursor_from(last_event_id ? *last_event_id : "")]() mutable {
              return next_of_stream(cursor);
            }};
  }
  if (path == "/v1/metrics") {
    const auto view = board_.snapshot();
    return {.content_type = "text/plain; version=0.0.4; charset=utf-8",
            .body = metrics_text(*view, age_s(*view), server)};
  }
  if (path == "/v1/hint") return take_hint(request);
  if (path == "/v1/object-location") return object_location(request);
  if (path == "/v1/playback") return control_playback(request);
  if (path == "/page.css") return page_answer(page::style, "text/css; charset=utf-8");
  if (path == "/page.js")
    return page_answer(fmt::format("{}{}{}{}", page::dom, map_page::calls, map_page::base_map, page::script),
                       "text/javascript; charset=utf-8");
  if (path == "/leaflet.js") return page_answer(map_page::leaflet_script, "text/javascript; charset=utf-8");
  if (path == "/leaflet.css") return page_answer(map_page::leaflet_style, "text/css; charset=utf-8");
  if (path == "/v1/vectors") {
    const auto package = this->package();
    return vectors_answer(package->vectors ? package->vectors() : std::nullopt);
  }
  if (path == "/") return page_answer(page::html, "text/html; charset=utf-8");
  return tile_answer(package()->tiles.get(), path.substr(kTiles.size()));
}

// A recording is never fit for anything, whatever it shows.
ApiResponse Api::health() const {
  const auto view = board_.snapshot();
  if (view->playback) {
    return without_cache(json_answer(503, {{"status", "fail"},
                                           {"state", name_of(view->state.state)},
                                           {"reason", "a recording is played: this is no flight"},
                                           {"age_s", 0}}));
  }
  const double age = age_s(*view);
  const bool stalled = view->version == 0 || age > options_.stalled_after_s;
  const ServiceState state = view->state.state;
  const bool fit = state == ServiceState::normal && view->recorder.state != RecorderState::failed;
  ApiResponse response =
      json_answer(stalled ? 503 : 200, {{"status", stalled ? "fail"
                                                   : fit   ? "pass"
                                                           : "warn"},
                                        {"state", name_of(state)},
                                        {"reason", stalled ? "the flight's thread is silent" : view->state.reason},
                                        {"age_s", age}});
  response.headers.emplace_back("Cache-Control", "no-store");
  return response;
}

ApiResponse Api::state() const {
  const auto view = board_.snapshot();
  nlohmann::json document = state_json(*view, age_s(*view));
  const auto list = [&](const std::vector<FlightEvent>& events) {
    nlohmann::json items = nlohmann::json::array();
    for (const FlightEvent& event : events) items.push_back(event_json(event, *view, age_s(*view)));
    return items;
  };
  document["events"] = list(view->events);
  document["alarms"] = list(view->alarms);
  document["track"] = track_json(*view);
  ApiResponse response = json_answer(200, document);
  response.headers.emplace_back("Cache-Control", "no-store");
  return response;
}

ApiResponse Api::control_playback(const ApiRequest& request) const {
  const auto view = board_.snapshot();
  if (!options_.control_playback || !view->playback) {
    return answer({.status = 409,
                   .type = "no-recording",
                   .detail = "no recording is played here: nadird --play RECORDING plays one"});
  }
  const auto parsed = parse_playback(request, view->playback->length_s);
  if (const auto* problem = std::get_if<Problem>(&parsed)) return answer(*problem);
  return json_answer(200, playback_json(options_.control_playback(std::get<PlaybackRequest>(parsed))));
}

ApiResponse Api::take_hint(const ApiRequest& request) const {
  if (board_.snapshot()->playback) {
    return answer({.status = 409,
                   .type = "recording",
                   .detail = "a recording is played: no hint changes where that aircraft was"});
  }
  const auto parsed = parse_hint(request);
  if (const auto* problem = std::get_if<Problem>(&parsed)) return answer(*problem);
  const auto allowed = [&] {
    const std::lock_guard lock(hint_mutex_);
    return hint_allowance_.take(options_.now_s());
  };
  if (!allowed()) {
    ApiResponse refusal =
        answer({.status = 429,
                .type = "too-many-hints",
                .detail = fmt::format("hints are taken every {} s; the last one still applies", kHintPeriod_s)});
    refusal.headers.emplace_back("Retry-After", fmt::format("{:.0f}", std::ceil(kHintPeriod_s)));
    return refusal;
  }
  hints_.put(std::get<Hint>(parsed));
  return json_answer(202, {{"accepted", true}});
}

ApiResponse Api::object_location(const ApiRequest& request) const {
  const auto package = this->package();
  return answer_object_location(request, *board_.snapshot(), {package->frame.get(), package->surface.get()});
}

}  // namespace nadir
