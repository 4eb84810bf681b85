#include "service/acceptance_record.hpp"

#include <nlohmann/json.hpp>

#include <utility>

#include "base/error.hpp"
#include "base/json.hpp"
#include "service/sealed_text.hpp"
#include "service/service_rules.hpp"

namespace nadir {
namespace {

constexpr const char* kAcceptanceSchema = "nadir.acceptance/1";

AcceptedPackage read_accepted(const JsonReader& in) {
  AcceptedPackage package{.manifest = in.digest("manifest"),
                          .folder = in.text("folder", {.least = 1, .most = 4096}),
                          .series = in.text("series"),
                          .sequence = in.integer("sequence", 0, std::int64_t{1} << 53),
                          .accepted_at = in.time("accepted_at"),
                          .airframe_file = in.text("airframe_file")};
  in.finish();
  return package;
}

nlohmann::json written(const AcceptedPackage& package) {
  return {{"manifest", package.manifest.hex()},
          {"folder", package.folder.string()},
          {"series", package.series},
          {"sequence", package.sequence},
          {"accepted_at", to_rfc3339(package.accepted_at)},
          {"airframe_file", package.airframe_file}};
}

}  // namespace

AcceptanceRecord accepted_next(const std::optional<AcceptanceRecord>& before, AcceptedPackage package,
                               std::string boot) {
  AcceptanceRecord next{std::move(package), std::nullopt, std::move(boot), false};
  if (!before) return next;
  next.previous = before->current.manifest == next.current.manifest ? before->previous : before->current;
  return next;
}

std::string to_text(const AcceptanceRecord& record) {
  nlohmann::json document{{"schema", kAcceptanceSchema},
                          {"boot_id", record.boot_id},
                          {"airborne", record.airborne},
                          {"current", written(record.current)}};
  if (record.previous) document["previous"] = written(*record.previous);
  std::string text = sealed(document.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace));
  const AcceptanceReading reading = parse_acceptance(text);
  if (!reading.record) throw Error({.what = "cannot save what was accepted", .found = reading.rejection});
  return text;
}

AcceptanceReading parse_acceptance(std::string_view text) {
  AcceptanceReading reading;
  const auto line = unsealed(text, reading.rejection);
  if (!line) return reading;
  try {
    const nlohmann::json document = parse_json(*line, "acceptance.json", {.max_depth = 4, .allow_floats = false});
    const JsonReader in(document, {.name = "acceptance.json", .what = "cannot resume what was accepted"});
    in.expect("schema", kAcceptanceSchema);
    AcceptanceRecord record{.current = read_accepted(in.object("current")),
                            .boot_id = in.text("boot_id"),
                            .airborne = in.boolean("airborne")};
    if (const auto previous = in.optional_object("previous")) record.previous = read_accepted(*previous);
    in.finish();
    reading.record = std::move(record);
  } catch (const std::exception& error) {
    reading.rejection = error.what();
  }
  return reading;
}

FlightPhase::Change FlightPhase::on_heartbeat(double now_s, bool armed) {
  if (armed) {
    armed_ever_ = true;
    disarmed_since_s_.reset();
    return std::exchange(airborne_, true) ? Change::none : Change::took_off;
  }
  if (!disarmed_since_s_) disarmed_since_s_ = now_s;
  if (!airborne_ || now_s - *disarmed_since_s_ < kLanded_s) return Change::none;
  airborne_ = false;
  return Change::landed;
}

}  // namespace nadir
