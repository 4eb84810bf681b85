#include "service/saved_flight.hpp"

#include <array>
#include <cmath>
#include <nlohmann/json.hpp>

#include "base/error.hpp"
#include "base/json.hpp"
#include "base/digest.hpp"

namespace nadir {
namespace {

using nlohmann::json;

constexpr const char* kSchema = "nadir.flight/1";
constexpr double kMaxMonotonic_s = 1e9;  // thirty years
constexpr double kMaxLength_m = 1e6;
constexpr double kMaxSpeed_m_s = 1e3;
constexpr std::int64_t kMaxUnix_us = std::int64_t{1} << 53;

struct Refusal {
  std::string text;
};

template <typename Names>
auto named(const json& value, const Names& names, const char* what) {
  for (const auto candidate : names) {
    if (value.is_string() && value.get_ref<const std::string&>() == name_of(candidate)) return candidate;
  }
  throw Refusal{std::string("no such ") + what + ": " + value.dump()};
}

constexpr std::array kStates{ServiceState::boot,         ServiceState::no_package, ServiceState::awaiting_autopilot,
                             ServiceState::relocalizing, ServiceState::normal,     ServiceState::degraded,
                             ServiceState::no_fix,       ServiceState::failsafe};
constexpr std::array kSources{SourceLabel::satellite_anchored, SourceLabel::vo_extrapolated, SourceLabel::dead_reckoned,
                              SourceLabel::no_fix};

const json& member(const json& object, const char* key) {
  if (!object.is_object() || !object.contains(key)) throw Refusal{std::string(key) + " is missing"};
  return object[key];
}

double number(const json& object, const char* key, double min, double max) {
  const json& value = member(object, key);
  const double found = value.is_number() ? value.get<double>() : std::nan("");
  if (std::isnan(found) || found < min || found > max)
    throw Refusal{std::string(key) + " is out of range: " + value.dump()};
  return found;
}

std::int64_t whole(const json& object, const char* key, std::int64_t max) {
  const json& value = member(object, key);
  if (!value.is_number_unsigned() || value.get<std::uint64_t>() > static_cast<std::uint64_t>(max)) {
    throw Refusal{std::string(key) + " is out of range: " + value.dump()};
  }
  return value.get<std::int64_t>();
}

LonLat read_place(const json& object) {
  return {number(object, "lon_deg", -180, 180), number(object, "lat_deg", -90, 90)};
}

std::optional<SavedVelocity> read_velocity(const json& object) {
  if (!object.contains("velocity")) return std::nullopt;
  const json& velocity = object["velocity"];
  return SavedVelocity{number(velocity, "east_m_s", -kMaxSpeed_m_s, kMaxSpeed_m_s),
                       number(velocity, "north_m_s", -kMaxSpeed_m_s, kMaxSpeed_m_s)};
}

SavedEstimate read_estimate(const json& object) {
  return {.monotonic_s = number(object, "monotonic_s", 0, kMaxMonotonic_s),
          .unix_us = whole(object, "unix_us", kMaxUnix_us),
          .place = read_place(object),
          .sigma_m = number(object, "sigma_m", 0, kMaxLength_m),
          .ground_speed_m_s = number(object, "ground_speed_m_s", 0, kMaxSpeed_m_s),
          .source = named(member(object, "source"), kSources, "source"),
          .segment = static_cast<int>(whole(object, "segment", 1 << 30)),
          .velocity = read_velocity(object)};
}

SavedFlight read_flight(const json& document) {
  if (member(document, "schema") != kSchema) throw Refusal{"schema is " + document["schema"].dump()};
  const json& boot = member(document, "boot_id");
  if (!boot.is_string()) throw Refusal{"boot_id is no text"};
  SavedFlight flight{.boot_id = boot.get<std::string>(),
                     .saved_monotonic_s = number(document, "monotonic_s", 0, kMaxMonotonic_s),
                     .saved_unix_us = whole(document, "unix_us", kMaxUnix_us),
                     .state = named(member(document, "state"), kStates, "state"),
                     .estimate = {},
                     .hint = {}};
  if (document.contains("estimate")) flight.estimate = read_estimate(document["estimate"]);
  if (document.contains("hint")) {
    const json& hint = document["hint"];
    flight.hint = SavedHint{read_place(hint), number(hint, "radius_m", 0, kMaxLength_m)};
  }
  return flight;
}

json written(const SavedFlight& flight) {
  json document{{"schema", kSchema},
                {"boot_id", flight.boot_id},
                {"monotonic_s", flight.saved_monotonic_s},
                {"unix_us", flight.saved_unix_us},
                {"state", name_of(flight.state)}};
  if (const auto& estimate = flight.estimate) {
    document["estimate"] = {{"monotonic_s", estimate->monotonic_s}, {"unix_us", estimate->unix_us},
                            {"lon_deg", estimate->place.lon_deg},   {"lat_deg", estimate->place.lat_deg},
                            {"sigma_m", estimate->sigma_m},         {"ground_speed_m_s", estimate->ground_speed_m_s},
                            {"source", name_of(estimate->source)},  {"segment", estimate->segment}};
  }
  if (flight.estimate && flight.estimate->velocity) {
    const SavedVelocity& velocity = *flight.estimate->velocity;
    document["estimate"]["velocity"] = {{"east_m_s", velocity.east_m_s}, {"north_m_s", velocity.north_m_s}};
  }
  if (const auto& hint = flight.hint) {
    document["hint"] = {
        {"lon_deg", hint->place.lon_deg}, {"lat_deg", hint->place.lat_deg}, {"radius_m", hint->radius_m}};
  }
  return document;
}

}  // namespace

std::string to_text(const SavedFlight& flight) {
  const std::string line = written(flight).dump(-1, ' ', false, json::error_handler_t::replace);
  std::string text = line + "\n" + sha256(as_bytes(line)).hex() + "\n";
  const SavedFlightReading reading = parse_saved_flight(text);
  if (!reading.flight) throw Error({.what = "this state of the flight cannot be saved", .found = reading.refusal});
  return text;
}

SavedFlightReading parse_saved_flight(std::string_view text) {
  const std::size_t end = text.find('\n');
  if (end == std::string_view::npos) return {std::nullopt, "cut off"};
  const std::string_view line = text.substr(0, end);
  if (text.substr(end + 1) != sha256(as_bytes(line)).hex() + "\n") return {std::nullopt, "the digest does not fit"};
  try {
    return {read_flight(parse_json(line, "saved flight", {.max_depth = 4})), {}};
  } catch (const Refusal& refusal) {
    return {std::nullopt, refusal.text};
  } catch (const Error& error) {
    return {std::nullopt, error.text().found.empty() ? error.text().what : error.text().found};
  }
}

}  // namespace nadir
