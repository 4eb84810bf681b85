#include "api/view_formats.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <initializer_list>
#include <iterator>
#include <nlohmann/json.hpp>

#include "base/number_text.hpp"
#include "base/printable.hpp"
#include "geodesy/angles.hpp"
#include "geodesy/error_ellipse.hpp"

namespace nadir {
namespace {

using nlohmann::json;

json number(double value) { return std::isfinite(value) ? json(value) : json(); }
json number(const std::optional<double>& value) { return value ? number(*value) : json(); }
json angle_deg(const std::optional<double>& angle_rad) { return angle_rad ? number(degrees(*angle_rad)) : json(); }
json heading_deg(const std::optional<double>& heading_rad) {
  if (!heading_rad) return {};
  const double turn = std::fmod(degrees(*heading_rad), 360);
  return number(turn < 0 ? turn + 360 : turn);
}
json place(LonLat place) { return json::array({number(place.lon_deg), number(place.lat_deg)}); }
json utc(const std::optional<UtcTime>& time) { return time ? json(to_rfc3339(*time)) : json(); }

json counts(const CountsByReason& counts) {
  json object = json::object();
  for (const auto& [reason, count] : counts) object[printable(reason)] = count;
  return object;
}

json ellipse(const PositionView& position) {
  const ErrorEllipse ellipse = error_ellipse(position.east_var_m2, position.east_north_cov_m2, position.north_var_m2);
  return {{"major_m", number(ellipse.major_m)},
          {"minor_m", number(ellipse.minor_m)},
          {"bearing_deg", number(ellipse.bearing_deg)}};
}

json position_json(const std::optional<PositionView>& position, double now_s) {
  if (!position) return {};
  return {{"lon", number(position->place.lon_deg)},
          {"lat", number(position->place.lat_deg)},
          {"sigma_m", number(position->sigma_m)},
          {"hpl_m", number(position->hpl_m)},
          {"covariance_m2",
           {number(position->east_var_m2), number(position->east_north_cov_m2), number(position->north_var_m2)}},
          {"ellipse", ellipse(*position)},
          {"age_s", number(std::max(0.0, now_s - position->at_s))}};
}

}  // namespace

json state_json(const FlightView& view, double age_s) {
  const double now_s = view.time_s + age_s;
  const auto age_of = [&](const std::optional<double>& time_s) {
    return time_s ? number(std::max(0.0, now_s - *time_s)) : json();
  };
  json document{{"boot", printable(view.boot_id)},
                {"version", view.version},
                {"time_s", number(view.time_s)},
                {"utc", utc(view.utc)},
                {"age_s", number(age_s)},
                {"state", name_of(view.state.state)},
                {"reason", printable(view.state.reason)},
                {"state_for_s", number(now_s - view.state.since_s)},
                {"position", position_json(view.position, now_s)},
                {"integrity",
                 {{"usable", view.integrity.usable},
                  {"risk", number(view.integrity.risk)},
                  {"alert_limit_m", number(view.integrity.alert_limit_m)},
                  {"time_to_alert_s", number(view.integrity.time_to_alert_s)}}},
                {"source", name_of(view.source)},
                {"anchor_age_s", age_of(view.anchored_s)},
                {"heading_deg", heading_deg(view.heading_rad)},
                {"pitch_deg", angle_deg(view.pitch_rad)},
                {"roll_deg", angle_deg(view.roll_rad)},
                {"velocity", nullptr},
                {"agl_m", number(view.agl_m)}};
  if (view.velocity) {
    document["velocity"] = {{"east_m_s", number(view.velocity->east_mps)},
                            {"north_m_s", number(view.velocity->north_mps)}};
  }
  document["frames"] = {{"received", view.frames.received},
                        {"dropped", view.frames.dropped},
                        {"per_s", number(view.frames.per_s)},
                        {"age_s", age_of(view.frames.last_s)}};
  document["anchors"] = {{"accepted", view.anchors.accepted},
                         {"failed", view.anchors.failed},
                         {"rejected", view.anchors.rejected},
                         {"rejected_by", counts(view.anchors.rejected_by)}};
  document["link"] = {{"connected", view.link.connected},
                      {"reason", printable(view.link.reason)},
                      {"signed", view.link.signed_frames},
                      {"age_s", age_of(view.link.last_message_s)},
                      {"fixes_sent", view.link.fixes_sent},
                      {"rivals", view.link.rivals},
                      {"rejected_by", counts(view.link.rejected_by)},
                      {"stations", json::array()}};
  for (const LinkView::Station& station : view.link.stations) {
    document["link"]["stations"].push_back({{"role", station.role},
                                            {"endpoint", station.endpoint},
                                            {"open", station.open},
                                            {"sent", station.sent},
                                            {"commands", station.commands}});
  }
  document["gps"] = {{"judgement", name_of(view.gps.judgement)}, {"reason", printable(view.gps.reason)}};
  document["recorder"] = {{"state", name_of(view.recorder.state)},
                          {"reason", printable(view.recorder.reason)},
                          {"written_bytes", view.recorder.written_bytes},
                          {"free_bytes", view.recorder.free_bytes},
                          {"lost_records", view.recorder.lost_records}};
  document["map"] = {{"corrupt_tiles", view.package.corrupt_tiles}};
  document["playback"] = view.playback ? playback_json(*view.playback) : json();
  return document;
}

json playback_json(const PlaybackView& playback) {
  return {
      {"session", printable(playback.session)}, {"recorded", utc(playback.recorded)}, {"at_s", number(playback.at_s)},
      {"length_s", number(playback.length_s)},  {"playing", playback.playing},        {"speed", playback.speed},
      {"notice", printable(playback.notice)}};
}

json event_json(const FlightEvent& event, const FlightView& view, double age_s) {
  return {{"id", event.id},
          {"time_s", number(event.time_s)},
          {"age_s", number(std::max(0.0, view.time_s + age_s - event.time_s))},
          {"count", event.count},
          {"replaces", event.replaces != 0 ? json(event.replaces) : json()},
          {"severity", name_of(event.severity)},
          {"kind", printable(event.kind)},
          {"text", printable(event.text)}};
}

json track_json(const FlightView& view) {
  json points = json::array();
  for (const TrackPoint& point : view.track) {
    points.push_back({{"lon", number(point.place.lon_deg)},
                      {"lat", number(point.place.lat_deg)},
                      {"sigma_m", number(point.sigma_m)},
                      {"source", name_of(point.source)}});
  }
  return points;
}

json package_json(const PackageView& package) {
  json route = json::array();
  for (const LonLat& point : package.route) route.push_back(place(point));
  json document{{"accepted", package.accepted},
                {"reason", printable(package.reason)},
                {"mission", printable(package.mission)},
                {"series", printable(package.series)},
                {"sequence", package.sequence},
                {"expires", utc(package.expires)},
                {"min_zoom", package.min_zoom},
                {"max_zoom", package.max_zoom},
                {"tiles", package.tiles},
                {"terrain", package.terrain},
                {"bounds", nullptr},
                {"route", std::move(route)}};
  if (package.bounds) {
    const LonLatBox& box = *package.bounds;
    document["bounds"] = {number(box.west_deg), number(box.south_deg), number(box.east_deg), number(box.north_deg)};
  }
  return document;
}

namespace {

// Ids are on their own line: letters and digits only.
std::string plain(std::string_view text) {
  std::string kept;
  for (const char c : text) {
    if ((c >= '0' && c <= '9') || (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z')) kept += c;
  }
  return kept;
}

}  // namespace

StreamCursor cursor_from(std::string_view last_event_id) {
  const std::size_t dash = last_event_id.rfind('-');
  if (dash == std::string_view::npos) return {};
  const auto last_event = whole_number<std::uint64_t>(last_event_id.substr(dash + 1));
  if (!last_event) return {};
  StreamCursor cursor;
  cursor.last_event = *last_event;
  cursor.boot_id = last_event_id.substr(0, dash);
  return cursor;
}

std::string stream_text(const FlightView& view, double age_s, StreamCursor& cursor) {
  const std::string boot = plain(view.boot_id);
  if (cursor.boot_id != boot) cursor = {.boot_id = boot};
  // A cursor ahead of every event is not from this run.
  if (!view.events.empty() && cursor.last_event > view.events.back().id) cursor.last_event = 0;

  std::string text;
  const auto out = std::back_inserter(text);
  if (cursor.last_event != 0 && view.events_gone > cursor.last_event) {
    fmt::format_to(out, "event: missed\ndata: {{\"count\":{}}}\n\n", view.events_gone - cursor.last_event);
  }
  for (const FlightEvent& event : view.events) {
    if (event.id <= cursor.last_event) continue;
    fmt::format_to(out, "id: {}-{}\nevent: log\ndata: {}\n\n", boot, event.id, event_json(event, view, age_s).dump());
    cursor.last_event = event.id;
  }
  if (cursor.version != view.version) {
    fmt::format_to(out, "event: state\ndata: {}\n\n", state_json(view, age_s).dump());
    cursor.version = view.version;
  }
  return text;
}

namespace {

// The label's value may hold anything: backslash and quote are escaped.
std::string escaped(std::string_view value) {
  std::string text;
  for (const char c : printable(value)) {
    if (c == '\\' || c == '"') text += '\\';
    text += c;
  }
  return text;
}

std::string shown(double value) {
  if (std::isnan(value)) return "NaN";
  if (std::isinf(value)) return value > 0 ? "+Inf" : "-Inf";
  return fmt::format("{}", value);
}

class MetricsText {
 public:
  void gauge(std::string_view name, std::string_view help, double value) {
    head(name, help, "gauge");
    line(name, {}, shown(value));
  }
  // Absent when unknown: any number in its place would be plotted.
  void gauge(std::string_view name, std::string_view help, const std::optional<double>& value) {
    if (value) gauge(name, help, *value);
  }
  void counter(std::string_view name, std::string_view help, std::uint64_t value) {
    head(name, help, "counter");
    line(name, {}, std::to_string(value));
  }
  void counters(std::string_view name, std::string_view help, const CountsByReason& counts) {
    if (counts.empty()) return;
    head(name, help, "counter");
    for (const auto& [reason, count] : counts) {
      line(name, fmt::format("{{reason=\"{}\"}}", escaped(reason)), std::to_string(count));
    }
  }
  // One of several: 1 for the one that holds, 0 for the others.
  void one_of(std::string_view name, std::string_view help, std::string_view holds,
              std::initializer_list<std::string_view> all, std::string_view label) {
    head(name, help, "gauge");
    for (const std::string_view value : all) {
      line(name, fmt::format("{{{}=\"{}\"}}", label, value), value == holds ? "1" : "0");
    }
  }
  std::string take() { return fmt::to_string(text_); }

 private:
  void head(std::string_view name, std::string_view help, std::string_view type) {
    fmt::format_to(std::back_inserter(text_), "# HELP nadir_{} {}\n# TYPE nadir_{} {}\n", name, help, name, type);
  }
  void line(std::string_view name, std::string_view labels, std::string_view value) {
    fmt::format_to(std::back_inserter(text_), "nadir_{}{} {}\n", name, labels, value);
  }

  fmt::memory_buffer text_;
};

std::optional<double> hpl_of(const FlightView& view) { return view.position ? view.position->hpl_m : std::nullopt; }

std::optional<double> sigma_of(const FlightView& view) {
  return view.position ? std::optional(view.position->sigma_m) : std::nullopt;
}

}  // namespace

std::string metrics_text(const FlightView& view, double age_s, const ServerCounts& server) {
  MetricsText text;
  text.gauge("view_age_seconds", "Age of the latest view of the flight.", age_s);
  text.one_of("state", "State of the service.", name_of(view.state.state),
              {"boot", "no_package", "awaiting_autopilot", "relocalizing", "normal", "degraded", "no_fix", "failsafe"},
              "state");
  text.one_of("source", "Source of the position.", name_of(view.source),
              {"satellite_anchored", "vo_extrapolated", "dead_reckoned", "no_fix"}, "source");
  text.gauge("position_sigma_meters", "1-sigma position error per axis.", sigma_of(view));
  text.gauge("protection_level_metres", "Radius that holds all but the integrity risk.", hpl_of(view));
  text.gauge("position_usable", "Whether it is within the alert limit.",
             view.integrity.usable && !view.playback ? 1.0 : 0.0);
  text.gauge("playback", "Whether all of this is a recording and not a flight.", view.playback ? 1.0 : 0.0);
  const auto age_of = [&](const std::optional<double>& time_s) {
    return time_s ? std::optional(std::max(0.0, view.time_s + age_s - *time_s)) : std::nullopt;
  };
  text.gauge("anchor_age_seconds", "Time since the last accepted anchor.", age_of(view.anchored_s));
  text.gauge("frame_age_seconds", "Time since the last frame arrived.", age_of(view.frames.last_s));
  text.gauge("link_age_seconds", "Time since the autopilot's last message.", age_of(view.link.last_message_s));
  text.gauge("agl_meters", "Height above ground.", view.agl_m);
  text.counter("frames_received_total", "Frames from the camera.", view.frames.received);
  text.counter("frames_dropped_total",
               "Frames not processed: superseded by a newer one, delivered late, or not decodable.",
               view.frames.dropped);
  text.gauge("frames_per_second", "Rate of frames.", view.frames.per_s);
  text.counter("anchors_accepted_total", "Accepted anchors.", view.anchors.accepted);
  text.counter("anchors_rejected_total", "Rejected anchors.", view.anchors.rejected);
  text.counter("anchors_failed_total", "Map matches that ended with an exception.", view.anchors.failed);
  text.counters("anchors_rejected_by_total", "Rejected anchors by verdict.", view.anchors.rejected_by);
  text.gauge("link_connected", "Whether the autopilot is connected.", view.link.connected ? 1.0 : 0.0);
  text.gauge("link_signed", "Whether its frames are signed.", view.link.signed_frames ? 1.0 : 0.0);
  text.counter("fixes_sent_total", "Positions sent to the autopilot; no fix is not counted.", view.link.fixes_sent);
  text.counters("link_frames_rejected_total", "Rejected frames by reason.", view.link.rejected_by);
  text.one_of("gps", "Assessment of the autopilot's GPS.", name_of(view.gps.judgement),
              {"unknown", "good", "denied", "spoofed"}, "judgement");
  text.one_of("recorder", "State of the flight recorder.", name_of(view.recorder.state),
              {"off", "recording", "limited", "failed"}, "state");
  text.counter("recorder_written_bytes_total", "Written by the recorder.", view.recorder.written_bytes);
  text.counter("recorder_lost_records_total", "Records that the recorder lost.", view.recorder.lost_records);
  text.counter("corrupt_tiles_total", "Tiles that are not the signed ones, found while reading.",
               view.package.corrupt_tiles);
  text.gauge("package_accepted", "Whether the map package was verified.", view.package.accepted ? 1.0 : 0.0);
  text.gauge("api_connections", "Open connections.", static_cast<double>(server.connections_open));
  text.counter("api_connections_total", "Accepted connections.", server.connections_total);
  text.counter("api_connections_refused_total", "Connections beyond the limit.", server.connections_refused);
  text.counter("api_requests_total", "Answered requests.", server.requests_total);
  text.gauge("api_streams", "Open event streams.", static_cast<double>(server.streams_open));
  text.counter("api_streams_refused_total", "Event streams beyond the limit.", server.streams_refused);
  text.counter("api_streams_dropped_total", "Event streams closed because their reader was too slow.",
               server.streams_dropped);
  return text.take();
}

}  // namespace nadir
