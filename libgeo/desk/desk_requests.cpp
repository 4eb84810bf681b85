#include "desk/desk_requests.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <numeric>
#include <utility>

#include "base/csv.hpp"
#include "base/error.hpp"
#include "base/number_text.hpp"
#include "geodesy/angles.hpp"
#include "geodesy/local_frame.hpp"
#include "http/json_body.hpp"
#include "http/multipart.hpp"
#include "replay/flight_folder.hpp"

namespace nadir {
namespace {

constexpr std::size_t kMaxFlightName = 200;  // bytes
constexpr std::size_t kMaxCamera = 16 * 1024;
constexpr std::size_t kMaxRows = 100'000;
constexpr double kMaxTime_s = 1e11;

constexpr NumberRange kLat{.low = -90, .high = 90}, kLon{.low = -180, .high = 180};

// What a row of telemetry may state beside its time: names and ranges of telemetry.csv (docs/formats.md).
struct Measure {
  const char* name;
  NumberRange range;
};
constexpr Measure kAgl{"agl_m", {.low = 1, .high = 20'000}}, kHeading{"heading_deg", {.low = -360, .high = 360}},
    kPitch{"pitch_deg", {.low = -90, .high = 90}}, kRoll{"roll_deg", {.low = -180, .high = 180}},
    kImuEast{"imu_dv_east_mps", {.low = -200, .high = 200}}, kImuNorth{"imu_dv_north_mps", {.low = -200, .high = 200}};

// get(measure): its value, if it was sent.
template <typename Get>
Telemetry telemetry_from(const Get& get) {
  Telemetry telemetry;
  const auto angle = [&get](const Measure& measure) -> std::optional<double> {
    const std::optional<double> value = get(measure);
    return value ? std::optional(radians(*value)) : std::nullopt;
  };
  telemetry.agl_m = get(kAgl);
  telemetry.heading_rad = angle(kHeading);
  telemetry.pitch_rad = angle(kPitch);
  telemetry.roll_rad = angle(kRoll);
  const std::optional<double> east = get(kImuEast), north = get(kImuNorth);
  if (east && north) telemetry.imu_dv_mps = Eigen::Vector2d(*east, *north);
  return telemetry;
}

Problem invalid(std::string detail, FieldErrors errors = {}) {
  return {.status = 400, .type = "invalid", .detail = std::move(detail), .errors = std::move(errors)};
}

std::variant<std::vector<PictureOffer>, Problem> parse_single(const ApiRequest& request) {
  auto query = parse_query(request.target);
  if (!query) return invalid("the query cannot be read");
  FieldErrors errors;
  const auto take = [&](const Measure& measure) -> std::optional<double> {
    const auto found = query->extract(measure.name);
    if (found.empty()) return std::nullopt;
    const auto value = finite_number(found.mapped());
    if (value && *value >= measure.range.low && *value <= measure.range.high) return value;
    errors.push_back({std::string("?") + measure.name,
                      fmt::format("must be a number from {} to {}", measure.range.low, measure.range.high)});
    return std::nullopt;
  };
  PictureOffer offer;
  offer.telemetry = telemetry_from(take);
  if (!query->contains("time_s")) errors.push_back({"?time_s", "is missing"});
  const auto time_s = take({"time_s", {.low = -kMaxTime_s, .high = kMaxTime_s}});
  if (time_s) offer.telemetry.time_s = *time_s;
  if (auto name = query->extract("name"); !name.empty()) offer.name = name.mapped();
  if (offer.name.empty()) errors.push_back({"?name", "is missing"});
  for (const auto& [name, value] : *query) errors.push_back({"?" + name, "is unknown"});
  if (!errors.empty()) return invalid("the query does not describe a picture; \"errors\" lists why", std::move(errors));
  offer.telemetry.frame = offer.name;
  offer.bytes = as_bytes(request.body);
  return std::vector{std::move(offer)};
}

std::variant<std::vector<Telemetry>, Problem> parse_rows(std::string_view text) {
  std::vector<Telemetry> rows;
  auto problem = read_json_object(text, [&rows](BodyFields& body, FieldErrors& /*errors*/) {
    for (BodyFields& row : body.objects("rows", {.least = 1, .most = kMaxRows})) {
      rows.push_back(
          telemetry_from([&row](const Measure& measure) { return row.optional_number(measure.name, measure.range); }));
      rows.back().frame = row.text("frame", {.least = 1, .most = 255});
      rows.back().time_s = row.number("time_s", {.low = -kMaxTime_s, .high = kMaxTime_s});
      row.finish();
    }
  });
  if (problem) return std::move(*problem);
  return rows;
}

std::variant<std::vector<Telemetry>, Problem> telemetry_of(const BodyPart& part) {
  if (part.content_type == "application/json") return parse_rows(part.bytes);
  try {
    return read_telemetry(CsvTable::parse(part.bytes, "telemetry"));
  } catch (const Error& error) {
    return Problem{.status = 400, .type = "telemetry", .detail = error.what()};
  }
}

std::variant<std::vector<PictureOffer>, Problem> parse_batch(const ApiRequest& request, std::size_t most) {
  if (const auto query = parse_query(request.target); !query || !query->empty()) {
    return invalid("a batch has its telemetry in a part of its own, not in the query");
  }
  const auto parts = parse_multipart(request.content_type, request.body, most + 1);
  if (!parts) {
    return Problem{.status = 400,
                   .type = "malformed",
                   .detail = fmt::format("the body is not multipart/form-data of at most {} pictures", most)};
  }
  std::map<std::string, Telemetry, std::less<>> rows;
  std::vector<PictureOffer> offers;
  bool has_telemetry = false;
  for (const BodyPart& part : *parts) {
    if (part.name == "picture") {
      offers.push_back({.name = part.filename, .telemetry = {}, .bytes = as_bytes(part.bytes), .folder = nullptr});
    } else if (part.name == "telemetry" && !std::exchange(has_telemetry, true)) {
      auto parsed = telemetry_of(part);
      if (auto* problem = std::get_if<Problem>(&parsed)) return std::move(*problem);
      for (Telemetry& row : std::get<std::vector<Telemetry>>(parsed)) {
        std::string name = row.frame;
        if (rows.emplace(std::move(name), std::move(row)).second) continue;
        return invalid("two rows of telemetry are of one picture");
      }
    } else {
      return invalid(R"(the parts of a batch are "picture", with a file name each, and one "telemetry")");
    }
  }
  if (offers.empty()) return invalid("the batch has no part \"picture\"");
  if (offers.size() > most) return invalid(fmt::format("a batch has at most {} pictures", most));
  for (PictureOffer& offer : offers) {
    const auto row = rows.find(offer.name);
    if (row != rows.end()) offer.telemetry = row->second;
    if (row == rows.end()) offer.telemetry.time_s = std::numeric_limits<double>::quiet_NaN();
  }
  return offers;
}

}  // namespace

NewFlight read_flight_members(BodyFields& body, CameraMember camera) {
  constexpr JsonLength kCamera{.least = 1, .most = kMaxCamera};
  NewFlight flight;
  flight.name = body.text("name", {.least = 1, .most = kMaxFlightName});
  flight.camera_text = camera == CameraMember::required ? body.text("camera", kCamera)
                                                        : body.optional_text("camera", kCamera).value_or(std::string());
  flight.package = body.optional_text("package", {.least = 1, .most = 64}).value_or(std::string());
  if (auto start = body.optional_object("start")) {
    const double lat_deg = start->number("lat", kLat), lon_deg = start->number("lon", kLon);
    flight.start = LonLat{.lon_deg = lon_deg, .lat_deg = lat_deg};
    start->finish();
  }
  return flight;
}

std::variant<NewFlight, Problem> parse_new_flight(const ApiRequest& request) {
  return read_body<NewFlight>(request, [](BodyFields& body, FieldErrors& /*errors*/) {
    return read_flight_members(body, CameraMember::required);
  });
}

std::variant<std::vector<PictureOffer>, Problem> parse_pictures(const ApiRequest& request, std::size_t most) {
  if (media_type(request.content_type) == "multipart/form-data") return parse_batch(request, most);
  return parse_single(request);
}

std::vector<std::size_t> order_of_time(const std::vector<PictureOffer>& offers) {
  std::vector<std::size_t> order(offers.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  const auto time_of = [&offers](std::size_t i) {
    const double time_s = offers[i].telemetry.time_s;
    return std::isfinite(time_s) ? time_s : std::numeric_limits<double>::infinity();
  };
  std::stable_sort(order.begin(), order.end(),
                   [&](std::size_t one, std::size_t other) { return time_of(one) < time_of(other); });
  return order;
}

}  // namespace nadir
