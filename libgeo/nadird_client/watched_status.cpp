#include "nadird_client/watched_status.hpp"

#include <cmath>
#include <nlohmann/json.hpp>

#include "base/error.hpp"
#include "base/json.hpp"
#include "base/printable.hpp"

namespace nadir {
namespace {

using nlohmann::json;

std::string text(const json& object, const char* name) { return printable(object.at(name).get<std::string>()); }

std::optional<double> number(const json& object, const char* name) {
  const json& value = object.at(name);
  return value.is_null() ? std::nullopt : std::optional(value.get<double>());
}

double number_or_zero(const json& object, const char* name) { return number(object, name).value_or(0); }

WatchedStatus status_from(const json& state) {
  WatchedStatus status;
  status.boot = text(state, "boot");
  status.state = text(state, "state");
  status.reason = text(state, "reason");
  status.source = text(state, "source");
  status.age_s = number_or_zero(state, "age_s");
  status.state_for_s = number_or_zero(state, "state_for_s");
  if (const json& position = state.at("position"); !position.is_null()) {
    status.lon_deg = number(position, "lon");
    status.lat_deg = number(position, "lat");
    status.sigma_m = number(position, "sigma_m");
  }
  if (const json& velocity = state.at("velocity"); !velocity.is_null()) {
    status.speed_mps = std::hypot(number_or_zero(velocity, "east_m_s"), number_or_zero(velocity, "north_m_s"));
  }
  status.anchor_age_s = number(state, "anchor_age_s");
  status.heading_deg = number(state, "heading_deg");
  status.agl_m = number(state, "agl_m");
  const json &frames = state.at("frames"), &anchors = state.at("anchors"), &link = state.at("link");
  status.frames_per_s = number_or_zero(frames, "per_s");
  status.frames_received = frames.at("received").get<std::uint64_t>();
  status.frames_dropped = frames.at("dropped").get<std::uint64_t>();
  status.anchors_accepted = anchors.at("accepted").get<std::uint64_t>();
  status.anchors_rejected = anchors.at("rejected").get<std::uint64_t>();
  status.link_connected = link.at("connected").get<bool>();
  status.link_signed = link.at("signed").get<bool>();
  status.fixes_sent = link.at("fixes_sent").get<std::uint64_t>();
  for (const auto& [reason, count] : link.at("rejected_by").items()) status.link_rejected += count.get<std::uint64_t>();
  status.gps = text(state.at("gps"), "judgement");
  status.gps_reason = text(state.at("gps"), "reason");
  status.recorder = text(state.at("recorder"), "state");
  status.recorder_reason = text(state.at("recorder"), "reason");
  for (const json& event : state.at("events")) {
    status.events.push_back({event.at("id").get<std::uint64_t>(), number_or_zero(event, "age_s"),
                             text(event, "severity"), text(event, "text")});
  }
  return status;
}

}  // namespace

WatchedStatus parse_watched_status(std::string_view json_text) {
  try {
    return status_from(parse_json(json_text, "/v1/state"));
  } catch (const json::exception& error) {
    throw Error({.what = "the answer is no state of a nadird",
                 .where = "/v1/state",
                 .expected = "schemas/nadird.openapi.yaml",
                 .found = printable(error.what()),
                 .fix = "is this the address of nadird, of the same version as this program?"});
  }
}

}  // namespace nadir
