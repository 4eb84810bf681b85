#include "desk/desk_api.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <nlohmann/json.hpp>
#include <opencv2/imgproc.hpp>
#include <utility>

#include "base/error.hpp"
#include "base/platform.hpp"
#include "desk/desk_annotations.hpp"
#include "desk/desk_documents.hpp"
#include "desk/desk_imports.hpp"
#include "desk/desk_missions.hpp"
#include "desk/desk_page.hpp"
#include "desk/desk_requests.hpp"
#include "desk/desk_routes.hpp"
#include "http/access.hpp"
#include "http/multipart.hpp"
#include "imagery/codecs.hpp"
#include "map_page/map_page.hpp"

namespace nadir {

namespace {

using nlohmann::json;

constexpr std::size_t kMaxRowsInAnswer = 10'000;
constexpr std::size_t kEventsInPiece = 200;  // of a stream
constexpr int kPreviewSide_px = 1024;
constexpr int kPreviewQuality = 80;
constexpr std::int64_t kPreviewTime_ms = 10'000;

ApiResponse try_later(int status, std::string type, std::string detail) {
  ApiResponse response = answer({.status = status, .type = std::move(type), .detail = std::move(detail)});
  response.headers.emplace_back("Retry-After", "2");
  return response;
}

ApiResponse not_found(std::string type, std::string detail) {
  return answer({.status = 404, .type = std::move(type), .detail = std::move(detail)});
}

ApiResponse invalid_query(std::string detail) {
  return answer({.status = 400, .type = "query", .detail = std::move(detail)});
}

// Text of an error for a caller: what, expected, found and what to do, without the paths of this machine.
std::string detail_of(const Error& error) {
  const ErrorText& text = error.text();
  std::string detail = text.what;
  if (!text.expected.empty()) detail += "; expected: " + text.expected;
  if (!text.found.empty()) detail += "; found: " + text.found;
  if (!text.fix.empty()) detail += "; " + text.fix;
  return detail;
}

ApiResponse image_answer(std::string_view bytes, ImageFormat format) {
  return {.content_type = fmt::format("image/{}", name_of(format)),
          .body = std::string(bytes),
          .headers = {{"Cache-Control", "private, max-age=86400, immutable"}}};
}

// What a query may ask for; parsed() is false when it asks for anything else.
class Query {
 public:
  explicit Query(std::string_view target) : values_(parse_query(target)) {}

  std::string take(const std::string& name, std::string value) {
    if (!values_) return value;
    if (auto found = values_->extract(name); !found.empty()) value = found.mapped();
    return value;
  }
  std::size_t take_number(const std::string& name, std::size_t value, std::size_t most) {
    const std::string text = take(name, std::to_string(value));
    const auto number = index_from(text);
    if (!number || *number > most) wrong_ = true;
    return number.value_or(value);
  }
  bool parsed() const { return values_ && values_->empty() && !wrong_; }

 private:
  std::optional<std::map<std::string, std::string>> values_;
  bool wrong_ = false;
};

std::optional<EstimateKind> parse_kind(std::string_view name) {
  for (const EstimateKind kind : {EstimateKind::online, EstimateKind::refined, EstimateKind::adjusted}) {
    if (name_of(kind) == name) return kind;
  }
  return std::nullopt;
}

ApiResponse events(const ApiRequest& request, const std::shared_ptr<LiveFlight>& flight) {
  Query query(request.target);
  const std::string* const header = request.header("last-event-id");
  const auto after = index_from(query.take("after", header != nullptr ? *header : "0"));
  if (!after || !query.parsed()) {
    return invalid_query("?after, or the header Last-Event-ID, is the number of the last event that the reader has");
  }
  ApiResponse response{.content_type = "text/event-stream", .headers = {{"Cache-Control", "no-store"}}};
  response.stream = [flight, last = static_cast<std::int64_t>(*after), seen = std::uint64_t{0}]() mutable {
    const std::uint64_t changes = flight->changes();  // before the events: what comes later is seen next time
    if (changes == seen) return std::string();
    const std::vector<EventRow> rows = flight->store().events_after(last, kEventsInPiece);
    if (rows.size() < kEventsInPiece) seen = changes;
    std::string text;
    for (const EventRow& row : rows) text += event_text(row);
    if (!rows.empty()) last = rows.back().id;
    return text;
  };
  return response;
}

ApiResponse take_back_merge(const DeskRoute& route, LiveFlight& flight) {
  const int number = static_cast<int>(route.item);
  if (!flight.take_back_merge(number)) {
    return not_found("segment", "the flight has no segment of this number that was placed as a whole");
  }
  for (const FlightSegment& segment : flight.store().segments()) {
    if (segment.number == number) return without_cache(json_answer(200, segment_json(segment)));
  }
  return not_found("segment", "the flight has no segment of this number");
}

ApiResponse estimates(const ApiRequest& request, const FlightStore& store) {
  Query query(request.target);
  const auto kind = parse_kind(query.take("kind", "online"));
  const std::size_t first = query.take_number("first", 0, 1'000'000'000);
  const std::size_t limit = query.take_number("limit", 5000, kMaxRowsInAnswer);
  if (!kind || !query.parsed()) {
    return invalid_query("?kind is online, refined or adjusted; ?first is a frame; ?limit is at most 10000");
  }
  const std::vector<Estimate> rows = store.estimates(*kind, first, limit);
  json list = json::array();
  for (std::size_t i = 0; i < rows.size(); ++i) list.push_back(estimate_json(first + i, rows[i]));
  return without_cache(json_answer(200, {{"kind", name_of(*kind)}, {"estimates", std::move(list)}}));
}

ApiResponse export_track(const ApiRequest& request, const LiveFlight& flight) {
  Query query(request.target);
  const std::string format_text = query.take("format", "geojson");
  const auto format = parse_track_format(format_text);
  const std::string kind_text = query.take("kind", "");
  auto kind = parse_kind(kind_text);
  const bool colmap = format_text == "colmap";
  if ((!format && !colmap) || !query.parsed() || (!kind && !kind_text.empty())) {
    return invalid_query("?format is geojson, csv, kml, gpx, geo or colmap; ?kind is online, refined or adjusted");
  }
  if (colmap) {
    auto archive = flight.reconstruction();
    if (!archive)
      return not_found("reconstruction", "complete the flight first: it is made with the adjusted estimates");
    ApiResponse response{.content_type = "application/zip", .body = std::move(*archive)};
    response.headers.emplace_back("Content-Disposition",
                                  fmt::format("attachment; filename=\"{}-colmap.zip\"", flight.id()));
    return without_cache(std::move(response));
  }
  const FlightStore& store = flight.store();
  if (!kind) {  // the best there is
    kind = EstimateKind::online;
    for (const EstimateKind better : {EstimateKind::refined, EstimateKind::adjusted}) {
      if (!store.estimates(better, 0, 1).empty()) kind = better;
    }
  }
  ApiResponse response{.content_type = std::string(media_type_of(*format)),
                       .body = track_text(*format, store.description().name, store.estimates(*kind))};
  response.headers.emplace_back("Content-Disposition", fmt::format("attachment; filename=\"{}-{}.{}\"", flight.id(),
                                                                   name_of(*kind), ending_of(*format)));
  return without_cache(std::move(response));
}

template <typename Rows, typename Format>
ApiResponse list_answer(const char* name, const Rows& rows, const Format& format) {
  json list = json::array();
  for (const auto& row : rows) list.push_back(format(row));
  return without_cache(json_answer(200, {{name, std::move(list)}}));
}

// Its share of the memory for bodies, until the response is written.
struct DeskAdmission final : HttpAdmission {
  DeskAdmission(DeskRoute to, std::atomic<std::uint64_t>& all_bodies) : route(std::move(to)), all(all_bodies) {}
  ~DeskAdmission() override { all -= share; }
  DeskAdmission(const DeskAdmission&) = delete;
  DeskAdmission& operator=(const DeskAdmission&) = delete;

  const DeskRoute route;
  std::atomic<std::uint64_t>& all;
  std::uint64_t share = 0;
};

}  // namespace

HttpLimits desk_http_limits() {
  return {.body_bytes = std::uint64_t{1} << 40,  // admit() decides, before a byte is read
          .connections = 256,
          .body_time = std::chrono::milliseconds(30'000),
          .slowest_bytes_s = 16 * 1024,
          .answer_time = std::chrono::milliseconds(60'000)};
}

DeskApi::DeskApi(DeskService& desk, FairQueue& queue, DeskApiOptions options)
    : desk_(desk), queue_(queue), options_(std::move(options)) {}

std::variant<std::shared_ptr<HttpAdmission>, ApiResponse> DeskApi::admit(const ApiRequest& header) const {
  if (const auto problem = access_problem(header, options_.loopback, options_.token)) {
    ApiResponse response = answer(*problem);
    if (problem->status == 401) response.headers.emplace_back("WWW-Authenticate", "Bearer");
    return response;
  }
  const auto route = desk_route(header.path(), header.method, options_.body_bytes);
  if (!route) return not_found("path", "there is no such path; GET /v1/openapi.json describes them all");
  if (auto response = refusal(*route, header)) return *std::move(response);
  auto admission = std::make_shared<DeskAdmission>(*route, bodies_bytes_);
  const std::uint64_t length = header.content_length.value_or(0);
  if (bodies_bytes_.fetch_add(length) + length > options_.bodies_bytes) {
    bodies_bytes_ -= length;
    return try_later(429, "too-many-requests", "others are sending now; send the same again");
  }
  admission->share = admission->body_bytes = length;
  admission->busy = route->body_max > 0;
  return std::shared_ptr<HttpAdmission>(std::move(admission));
}

void DeskApi::serve(ApiRequest request, const HttpAdmission& admitted, const ServerCounts&, Respond respond) const {
  const DeskRoute& route = static_cast<const DeskAdmission&>(admitted).route;
  auto shared = std::make_shared<ApiRequest>(std::move(request));
  const bool taken = queue_.put(lane_of(route), [this, shared, respond, &route]() mutable {
    ApiResponse response = answered(route, *shared);
    shared.reset();
    std::exchange(respond, nullptr)(std::move(response));  // with it goes the connection
  });
  if (!taken) respond(try_later(429, "too-many-requests", "too many requests wait; send the same again"));
}

ApiResponse DeskApi::handle(const ApiRequest& request) const {
  auto admitted = admit(request);
  if (auto* response = std::get_if<ApiResponse>(&admitted)) return std::move(*response);
  const auto admission = std::get<std::shared_ptr<HttpAdmission>>(admitted);
  return answered(static_cast<const DeskAdmission&>(*admission).route, request);
}

ApiResponse DeskApi::answered(const DeskRoute& route, const ApiRequest& request) const {
  ApiResponse response;
  try {
    response = dispatch(route, request);
  } catch (const DeskBusy& error) {
    response = try_later(503, "busy", detail_of(error));
  } catch (const OutOfSpace& error) {
    response = answer({.status = 507, .type = "storage-full", .detail = detail_of(error)});
  } catch (const UsageError& error) {
    response = answer({.status = 422, .type = "refused", .detail = detail_of(error)});
  } catch (const Error& error) {
    response = answer({.status = 500, .type = "failed", .detail = detail_of(error)});
  } catch (const std::exception& error) {
    response = answer({.status = 500, .type = "internal", .detail = error.what()});
  }
  response.headers.emplace_back("X-Content-Type-Options", "nosniff");
  return response;
}

ApiResponse DeskApi::dispatch(const DeskRoute& route, const ApiRequest& request) const {
  switch (route.path) {
    case DeskPath::page: return page_answer(desk_page::html, "text/html; charset=utf-8");
    case DeskPath::style: return page_answer(desk_page::style, "text/css; charset=utf-8");
    case DeskPath::leaflet_script: return page_answer(map_page::leaflet_script, "text/javascript; charset=utf-8");
    case DeskPath::leaflet_style: return page_answer(map_page::leaflet_style, "text/css; charset=utf-8");
    case DeskPath::script:
      return page_answer(fmt::format("{}{}{}{}{}{}", desk_page::dom, map_page::calls, map_page::base_map,
                                     map_page::flight_map, map_page::picture, desk_page::script),
                         "text/javascript; charset=utf-8");
    case DeskPath::missions_page: return page_answer(desk_page::missions_html, "text/html; charset=utf-8");
    case DeskPath::missions_style: return page_answer(desk_page::missions_style, "text/css; charset=utf-8");
    case DeskPath::missions_script:
      return page_answer(
          fmt::format("{}{}{}{}", desk_page::dom, map_page::calls, map_page::base_map, desk_page::missions_script),
          "text/javascript; charset=utf-8");
    case DeskPath::drawing_script: return page_answer(map_page::drawing_script, "text/javascript; charset=utf-8");
    default: break;
  }
  if (route.path == DeskPath::health) {
    return without_cache(json_answer(200, {{"status", "pass"}, {"flights", desk_.list().size()}}));
  }
  if (route.path == DeskPath::contract) return {.body = std::string(desk_page::contract)};
  if (route.path == DeskPath::packages) {
    return list_answer("packages", desk_.packages().list(desk_.limits().packages), package_json);
  }
  if (route.path == DeskPath::tile) {
    const auto listing = desk_.packages().find(route.name);
    if (!listing || !listing->package) return not_found("package", "there is no accepted package of this name");
    return tile_answer(listing->package->tiles.get(), route.tile);
  }
  if (route.path == DeskPath::vectors) {
    const auto listing = desk_.packages().find(route.name);
    if (!listing || !listing->package) return not_found("package", "there is no accepted package of this name");
    return vectors_answer(listing->package->package->read_vectors());
  }
  if (route.path == DeskPath::imports || route.path == DeskPath::import_files ||
      route.path == DeskPath::import_flight || route.path == DeskPath::import_item) {
    return import_call(route, request, desk_);
  }
  if (route.path == DeskPath::flights) {
    if (request.method == "POST") return create(request);
    return list_answer("flights", desk_.list(), [](const FlightSummary& flight) { return flight_json(flight); });
  }
  if (is_mission_path(route.path)) return mission_call(route, request, desk_);
  const std::shared_ptr<LiveFlight> flight = desk_.open(route.name);
  if (!flight) return not_found("flight", "there is no flight of this id");
  return flight_call(route, request, flight);
}

ApiResponse DeskApi::flight_call(const DeskRoute& route, const ApiRequest& request,
                                 const std::shared_ptr<LiveFlight>& flight) const {
  const FlightStore& store = flight->store();
  switch (route.path) {
    case DeskPath::flight: return without_cache(json_answer(200, flight_json(desk_.summary(*flight), store)));
    case DeskPath::pictures: return take_pictures(request, *flight);
    case DeskPath::picture: return picture(request, route.frame, store);
    case DeskPath::events: return events(request, flight);
    case DeskPath::estimates: return estimates(request, store);
    case DeskPath::segments: return list_answer("segments", store.segments(), segment_json);
    case DeskPath::merge: return take_back_merge(route, *flight);
    case DeskPath::footprint:
    case DeskPath::fixes:
    case DeskPath::fix:
    case DeskPath::objects:
    case DeskPath::object:
    case DeskPath::sightings:
    case DeskPath::sighting: return annotation_call(route, request, *flight, ground_of(store));
    case DeskPath::complete:
      if (store.accepted() == 0) {
        return answer({.status = 409, .type = "no-pictures", .detail = "send the flight's pictures first"});
      }
      flight->request_completion();
      return json_answer(202, {{"completion_requested", true}});
    case DeskPath::export_track: return export_track(request, *flight);
    default: return look(route, *flight);
  }
}

// Of a frame whose segment was placed as a whole, the look in flight was at another place.
ApiResponse DeskApi::look(const DeskRoute& route, const LiveFlight& flight) const {
  const FlightStore& store = flight.store();
  if (route.frame >= store.processed()) return not_found("frame", "no processed frame has this number");
  const auto anew = placed_looks_.of(flight.id(), store, ground_of(store), route.frame);
  const StoredFrame stored = anew ? StoredFrame{} : store.stored_frame(route.frame);
  const Bytes &seen = anew ? anew->seen : stored.seen, &map = anew ? anew->map : stored.map;
  if (route.path == DeskPath::look) {
    const AnchorReport report = anew ? anew->report : store.look_of(route.frame);
    return without_cache(json_answer(200, look_json(route.frame, report, seen, map, anew != nullptr)));
  }
  const Bytes& image = route.path == DeskPath::seen ? seen : map;
  if (image.empty()) return not_found("look", "no image of a look at the map was kept for this frame");
  return without_cache({.content_type = "image/jpeg", .body = std::string(as_text(image))});  // a placement changes it
}

FlightGround DeskApi::ground_of(const FlightStore& store) const {
  const FlightDescription& flight = store.description();
  const auto listing = flight.package.empty() ? std::nullopt : desk_.packages().find(flight.package);
  const bool usable = listing && listing->package && flight.session.package == listing->package->manifest;
  return {store, usable ? listing->package : nullptr};
}

ApiResponse DeskApi::create(const ApiRequest& request) const {
  auto parsed = parse_new_flight(request);
  if (const auto* problem = std::get_if<Problem>(&parsed)) return answer(*problem);
  const std::shared_ptr<LiveFlight> flight = desk_.create(std::get<NewFlight>(parsed));
  ApiResponse response = json_answer(201, flight_json(desk_.summary(*flight), flight->store()));
  response.headers.emplace_back("Location", "/v1/flights/" + flight->id());
  return response;
}

ApiResponse DeskApi::take_pictures(const ApiRequest& request, LiveFlight& flight) const {
  desk_.check_space(request.body.size());
  auto parsed = parse_pictures(request, desk_.limits().pictures.batch_pictures);
  if (const auto* problem = std::get_if<Problem>(&parsed)) return answer(*problem);
  const auto& offers = std::get<std::vector<PictureOffer>>(parsed);
  const std::vector<std::size_t> order = order_of_time(offers);
  std::vector<PictureOffer> sorted;
  for (const std::size_t i : order) sorted.push_back(offers[i]);
  std::vector<PictureAnswer> sorted_answers = flight.accept(sorted);
  std::vector<PictureAnswer> answers(offers.size());
  for (std::size_t i = 0; i < order.size(); ++i) answers[order[i]] = std::move(sorted_answers[i]);
  return json_answer(200, answers_json(answers));
}

ApiResponse DeskApi::picture(const ApiRequest& request, std::size_t frame, const FlightStore& store) const {
  Query query(request.target);
  const std::string preview = query.take("preview", "false");
  if (!query.parsed() || (preview != "true" && preview != "false")) return invalid_query("?preview is true or false");
  if (frame >= store.accepted()) return not_found("frame", "the flight has no picture of this number");
  const Bytes bytes = store.read_picture(frame);
  const auto format = sniff_image_format(bytes);
  if (!format) return not_found("picture", "the picture is not stored here");
  if (preview == "false") return image_answer(as_text(bytes), *format);
  const std::lock_guard one_at_a_time(decoding_);
  try {
    const ImageInfo info = read_image_info(bytes, "picture");
    int shrink = 1;
    while (shrink < 8 && std::max(info.width, info.height) / (2 * shrink) >= kPreviewSide_px) shrink *= 2;
    cv::Mat image =
        decode_image(bytes, Colour::bgr, "picture", shrink, {.max_scans = 100, .limit_ms = kPreviewTime_ms}).image;
    const double factor = static_cast<double>(kPreviewSide_px) / std::max(image.cols, image.rows);
    if (factor < 1) cv::resize(image, image, {}, factor, factor, cv::INTER_AREA);
    return image_answer(as_text(encode_image(image, ImageFormat::jpeg, kPreviewQuality)), ImageFormat::jpeg);
  } catch (const Error& error) {
    return answer({.status = 422, .type = "undecodable", .detail = detail_of(error)});
  }
}

}  // namespace nadir
