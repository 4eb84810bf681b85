#include "service/saved_flight.hpp"

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <exception>
#include <utility>

#include "base/digest.hpp"
#include "base/error.hpp"
#include "base/files.hpp"
#include "base/json.hpp"
#include "geodesy/hypotenuse.hpp"
#include "geodesy/local_frame.hpp"
#include "service/sealed_text.hpp"
#include "service/service_rules.hpp"

namespace nadir {
namespace fs = std::filesystem;
namespace {

using nlohmann::json;

constexpr const char* kSchema = "nadir.flight/1";
constexpr double kMaxMonotonic_s = 1e9;  // thirty years
constexpr double kMaxLength_m = 1e6;
constexpr double kMaxSpeed_mps = 1e3;
constexpr std::int64_t kMaxUnix_us = std::int64_t{1} << 53;

constexpr std::array kStates{ServiceState::boot,         ServiceState::no_package, ServiceState::awaiting_autopilot,
                             ServiceState::relocalizing, ServiceState::normal,     ServiceState::degraded,
                             ServiceState::no_fix,       ServiceState::failsafe};
constexpr std::array kSources{SourceLabel::satellite_anchored, SourceLabel::vo_extrapolated, SourceLabel::dead_reckoned,
                              SourceLabel::no_fix};

LonLat read_place(const JsonReader& in) { return {in.number("lon_deg", -180, 180), in.number("lat_deg", -90, 90)}; }

std::optional<SavedVelocity> read_velocity(const JsonReader& in) {
  const auto velocity = in.optional_object("velocity");
  if (!velocity) return std::nullopt;
  return SavedVelocity{velocity->number("east_m_s", -kMaxSpeed_mps, kMaxSpeed_mps),
                       velocity->number("north_m_s", -kMaxSpeed_mps, kMaxSpeed_mps)};
}

SavedEstimate read_estimate(const JsonReader& in) {
  return {.monotonic_s = in.number("monotonic_s", 0, kMaxMonotonic_s),
          .unix_us = in.integer("unix_us", 0, kMaxUnix_us),
          .place = read_place(in),
          .sigma_m = in.number("sigma_m", 0, kMaxLength_m),
          .ground_speed_mps = in.number("ground_speed_m_s", 0, kMaxSpeed_mps),
          .source = in.choice("source", kSources),
          .segment = in.integer<int>("segment", 0, 1 << 30),
          .velocity = read_velocity(in)};
}

SavedFlight read_flight(const json& document) {
  const JsonReader in(document, {.name = "saved flight", .what = "cannot restore the saved flight"});
  in.expect("schema", kSchema);
  SavedFlight flight{.boot_id = in.text("boot_id"),
                     .saved_monotonic_s = in.number("monotonic_s", 0, kMaxMonotonic_s),
                     .saved_unix_us = in.integer("unix_us", 0, kMaxUnix_us),
                     .state = in.choice("state", kStates),
                     .estimate = {},
                     .hint = {}};
  if (const auto estimate = in.optional_object("estimate")) flight.estimate = read_estimate(*estimate);
  if (const auto hint = in.optional_object("hint")) {
    flight.hint = SavedHint{read_place(*hint), hint->number("radius_m", 0, kMaxLength_m)};
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
                            {"sigma_m", estimate->sigma_m},         {"ground_speed_m_s", estimate->ground_speed_mps},
                            {"source", name_of(estimate->source)},  {"segment", estimate->segment}};
  }
  if (flight.estimate && flight.estimate->velocity) {
    const SavedVelocity& velocity = *flight.estimate->velocity;
    document["estimate"]["velocity"] = {{"east_m_s", velocity.east_mps}, {"north_m_s", velocity.north_mps}};
  }
  if (const auto& hint = flight.hint) {
    document["hint"] = {
        {"lon_deg", hint->place.lon_deg}, {"lat_deg", hint->place.lat_deg}, {"radius_m", hint->radius_m}};
  }
  return document;
}

constexpr std::uint64_t kMaxFileSize = 1 << 16;
constexpr std::uint64_t kMaxAcceptanceSize = 1 << 22;
constexpr const char* kAcceptanceFile = "acceptance.json";

struct Age {
  double s = 0;
  bool same_boot = false;
};

Age age_of(const SavedFlight& flight, double monotonic_s, std::int64_t unix_us, const FlightClock& clock,
           bool same_flight) {
  const double now_s = clock.monotonic_s();
  if (!flight.boot_id.empty() && flight.boot_id == clock.boot_id()) return {now_s - monotonic_s, true};
  const double by_utc_s = 1e-6 * static_cast<double>(clock.unix_us() - unix_us);
  if (same_flight && (by_utc_s < 0 || by_utc_s > kMaxRestartAge_s)) return {now_s + kRebootAllowance_s, false};
  if (by_utc_s < 0) return {by_utc_s, false};
  return {std::max(by_utc_s, now_s) + kRebootAllowance_s, false};
}

// Propagated with its velocity.
RestartPosition propagated(const SavedEstimate& estimate, const SavedVelocity& velocity, double age_s) {
  const double turn_m = 0.5 * kRestartTurn_mps2 * age_s * age_s;
  const double waiting_m = kFirstFrameAfterRestart_s * hypotenuse(velocity.east_mps, velocity.north_mps);
  return {
      .place = LocalFrame(estimate.place).lonlat_from_plane({velocity.east_mps * age_s, velocity.north_mps * age_s}),
      .sigma_m = estimate.sigma_m + hypotenuse(turn_m, kRestartVelocitySigma_mps * age_s, waiting_m)};
}

}  // namespace

std::string to_text(const SavedFlight& flight) {
  const std::string line = written(flight).dump(-1, ' ', false, json::error_handler_t::replace);
  std::string text = sealed(line);
  const SavedFlightReading reading = parse_saved_flight(text);
  if (!reading.flight) throw Error({.what = "cannot save this state of the flight", .found = reading.rejection});
  return text;
}

SavedFlightReading parse_saved_flight(std::string_view text) {
  std::string rejection;
  const auto line = unsealed(text, rejection);
  if (!line) return {std::nullopt, rejection};
  try {
    const json document = parse_json(*line, "saved flight", {.max_depth = 4});
    return {read_flight(document), {}};
  } catch (const Error& error) {
    return {std::nullopt, error.what()};
  }
}

void StateDirectory::prepare() const {
  std::error_code error;
  fs::create_directories(folder_, error);
  if (error || !fs::is_directory(folder_)) {
    throw Error({.what = "cannot use the state directory",
                 .where = folder_,
                 .expected = "a writable folder",
                 .found = error ? error.message() : "not a folder",
                 .fix = "give --state a folder that only the service uses"});
  }
  for (const auto& entry : fs::directory_iterator(folder_)) {
    const std::string name = entry.path().filename();  // of a process that died, see PendingFile
    if (name.starts_with(".") && name.ends_with(".tmp")) fs::remove(entry.path(), error);
  }
  write_file_atomic(folder_ / ".writable", "");
  fs::remove(folder_ / ".writable", error);
}

std::optional<std::string> StateDirectory::save(const SavedFlight& flight) const {
  try {
    write_file_atomic(file(), to_text(flight));
    return std::nullopt;
  } catch (const std::exception& error) {
    return error.what();
  }
}

SavedFlightReading StateDirectory::load() const {
  std::error_code ignored;
  if (!fs::exists(fs::symlink_status(file(), ignored))) return {std::nullopt, "no saved state: cold start"};
  SavedFlightReading reading;
  try {
    reading = parse_saved_flight(read_text_file(file(), kMaxFileSize));
  } catch (const Error& error) {
    reading.rejection = error.what();
  }
  if (!reading.flight) reading.rejection = "cold start, the saved flight cannot be used: " + reading.rejection;
  return reading;
}

void StateDirectory::save(const AcceptanceRecord& record) const {
  write_file_atomic(folder_ / kAcceptanceFile, to_text(record));
}

AcceptanceReading StateDirectory::load_acceptance() const {
  const fs::path path = folder_ / kAcceptanceFile;
  std::error_code ignored;
  if (!fs::exists(fs::symlink_status(path, ignored))) return {};
  try {
    return parse_acceptance(read_text_file(path, kMaxAcceptanceSize));
  } catch (const std::exception& error) {
    return {std::nullopt, error.what()};
  }
}

Restart restart_from(const SavedFlightReading& reading, const FlightClock& clock, bool same_flight) {
  if (!reading.flight) return {{}, {}, reading.rejection};
  const SavedFlight& flight = *reading.flight;

  const Age saved = age_of(flight, flight.saved_monotonic_s, flight.saved_unix_us, clock, same_flight);
  if (saved.s < 0) return {{}, {}, fmt::format("saved {:.0f} s in the future: cold start", -saved.s)};
  if (saved.s > kMaxRestartAge_s)
    return {{}, {}, fmt::format("saved {:.0f} s ago, by another flight: cold start", saved.s)};

  Restart restart{{}, flight.hint, {}};
  if (!flight.estimate || flight.estimate->source == SourceLabel::no_fix) {
    restart.reason = fmt::format("saved {:.1f} s ago without a position", saved.s);
    return restart;
  }
  const SavedEstimate& estimate = *flight.estimate;
  const Age age = age_of(flight, estimate.monotonic_s, estimate.unix_us, clock, same_flight);
  if (age.s < saved.s) {
    restart.reason = "the saved position is newer than its file";
    return restart;
  }
  const double speed_mps = std::max(estimate.ground_speed_mps, kMinRestartSpeed_mps);
  RestartPosition position{.place = estimate.place, .sigma_m = estimate.sigma_m + age.s * speed_mps};
  if (estimate.velocity) {
    const RestartPosition moving = propagated(estimate, *estimate.velocity, age.s);
    if (moving.sigma_m < position.sigma_m) position = moving;
  }
  position.speed_mps = speed_mps;
  position.age_s = age.s;
  position.segment = estimate.segment;
  restart.position = position;
  restart.reason = fmt::format("restored the position of {:.1f} s ago{}, σ grown from {:.0f} m to {:.0f} m", age.s,
                               age.same_boot ? "" : ", before a reboot", estimate.sigma_m, position.sigma_m);
  return restart;
}

}  // namespace nadir
