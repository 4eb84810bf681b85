#include "nadird_client/nadird_client.hpp"

#include <fmt/format.h>

#include <nlohmann/json.hpp>
#include <optional>

#include "base/error.hpp"
#include "base/json.hpp"
#include "base/printable.hpp"
#include "geodesy/hypotenuse.hpp"
#include "http/client.hpp"

namespace nadir {
namespace {

constexpr std::size_t kLongestProblem = 400;  // shown, bytes

}  // namespace

NadirdClient::NadirdClient(std::string_view url, std::string token, std::chrono::milliseconds timeout)
    : url_(url), token_(std::move(token)), timeout_(timeout) {
  constexpr std::string_view kScheme = "http://";
  std::string_view address = url;
  if (address.ends_with('/')) address.remove_suffix(1);
  if (address.starts_with(kScheme)) {
    address.remove_prefix(kScheme.size());
    const std::size_t colon = address.rfind(':');
    const bool has_port = colon != std::string_view::npos && address.find(']', colon) == std::string_view::npos;
    host_ = address.substr(0, has_port ? colon : address.size());
    port_ = has_port ? std::string(address.substr(colon + 1)) : "8750";
  }
  const auto all_of = [](const std::string& text, std::string_view allowed) {
    return !text.empty() && text.find_first_not_of(allowed) == std::string::npos;
  };
  if (!all_of(host_, "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789.-_:[]") ||
      !all_of(port_, "0123456789")) {
    throw UsageError({.what = "not the URL of a service",
                      .expected = fmt::format("http://HOST:PORT, as in {}", kDefaultServiceUrl),
                      .found = printable_url(url)});
  }
}

std::string NadirdClient::get(const std::string& path) const {
  auto result = http_get({.host = host_, .port = port_, .path = path, .bearer_token = token_}, timeout_);
  if (const auto* none = std::get_if<NoHttpAnswer>(&result)) {
    throw Error({.what = "the service does not answer",
                 .where = url_ + path,
                 .found = printable(none->reason),
                 .fix = "start nadird, or give the address that it listens on"});
  }
  auto& answer = std::get<HttpAnswer>(result);
  if (answer.status != 200) {
    throw Error({.what = "the service refuses the request",
                 .where = url_ + path,
                 .expected = "200",
                 .found = fmt::format("{}: {}", answer.status, printable(answer.body.substr(0, kLongestProblem))),
                 .fix = answer.status == 401 ? "give the file with its token: --token-file FILE" : ""});
  }
  return std::move(answer.body);
}

namespace {

std::string text(const JsonReader& in, const char* key) { return printable(in.text(key)); }

std::optional<double> number(const JsonReader& in, const char* key) {
  return in.is_null(key) ? std::nullopt : std::optional(in.number(key));
}

double number_or_zero(const JsonReader& in, const char* key) { return number(in, key).value_or(0); }

std::uint64_t count(const JsonReader& in, const std::string& key) {
  return static_cast<std::uint64_t>(in.integer(key, 0, std::int64_t{1} << 62));
}

std::vector<WatchedEvent> event_list(const JsonReader& in, const char* key) {
  std::vector<WatchedEvent> list;
  const JsonReader events = in.array(key);
  for (std::size_t i = 0; i < events.size(); ++i) {
    const JsonReader event = events.object(i);
    list.push_back({.id = count(event, "id"),
                    .count = count(event, "count"),
                    .age_s = number_or_zero(event, "age_s"),
                    .severity = text(event, "severity"),
                    .text = text(event, "text")});
  }
  return list;
}

}  // namespace

// A newer service may send members that this program does not know.
WatchedStatus parse_watched_status(std::string_view json_text) {
  const nlohmann::json document = parse_json(json_text, "/v1/state");
  const JsonReader in(document, {.name = "/v1/state",
                                 .what = "the answer is not the state of a nadird",
                                 .fix = "is this the address of nadird, of the same version as this program?"});
  WatchedStatus status;
  status.boot = text(in, "boot");
  status.state = text(in, "state");
  status.reason = text(in, "reason");
  status.source = text(in, "source");
  status.age_s = number_or_zero(in, "age_s");
  status.state_for_s = number_or_zero(in, "state_for_s");
  if (!in.is_null("position")) {
    const JsonReader position = in.object("position");
    status.lon_deg = number(position, "lon");
    status.lat_deg = number(position, "lat");
    status.sigma_m = number(position, "sigma_m");
    status.hpl_m = number(position, "hpl_m");
  }
  const JsonReader integrity = in.object("integrity");
  status.usable = integrity.boolean("usable");
  status.alert_limit_m = number_or_zero(integrity, "alert_limit_m");
  if (!in.is_null("velocity")) {
    const JsonReader velocity = in.object("velocity");
    status.speed_mps = hypotenuse(number_or_zero(velocity, "east_m_s"), number_or_zero(velocity, "north_m_s"));
  }
  status.anchor_age_s = number(in, "anchor_age_s");
  status.heading_deg = number(in, "heading_deg");
  status.agl_m = number(in, "agl_m");
  const JsonReader frames = in.object("frames"), anchors = in.object("anchors"), link = in.object("link");
  status.frames_per_s = number_or_zero(frames, "per_s");
  status.frames_received = count(frames, "received");
  status.frames_dropped = count(frames, "dropped");
  status.anchors_accepted = count(anchors, "accepted");
  status.anchors_rejected = count(anchors, "rejected");
  status.anchors_failed = count(anchors, "failed");
  status.corrupt_tiles = count(in.object("map"), "corrupt_tiles");
  status.frame_age_s = number(frames, "age_s");
  status.link_age_s = number(link, "age_s");
  status.link_connected = link.boolean("connected");
  if (link.has("reason")) status.link_reason = text(link, "reason");
  status.link_signed = link.boolean("signed");
  status.fixes_sent = count(link, "fixes_sent");
  const JsonReader rejected_by = link.object("rejected_by");
  for (const std::string& reason : rejected_by.keys()) status.link_rejected += count(rejected_by, reason);
  const JsonReader gps = in.object("gps"), recorder = in.object("recorder");
  status.gps = text(gps, "judgement");
  status.gps_reason = text(gps, "reason");
  status.recorder = text(recorder, "state");
  status.recorder_reason = text(recorder, "reason");
  status.playback = in.has("playback") && !in.is_null("playback");
  if (status.playback) {
    const JsonReader playback = in.object("playback");
    if (!playback.is_null("recorded")) status.recorded = text(playback, "recorded");
  }
  status.events = event_list(in, "events");
  status.alarms = event_list(in, "alarms");
  return status;
}

WatchedStatus aged(WatchedStatus status, double seconds) {
  status.age_s += seconds;
  status.state_for_s += seconds;
  for (std::optional<double>* age_s : {&status.anchor_age_s, &status.frame_age_s, &status.link_age_s}) {
    if (*age_s) **age_s += seconds;
  }
  for (std::vector<WatchedEvent>* list : {&status.events, &status.alarms}) {
    for (WatchedEvent& event : *list) event.age_s += seconds;
  }
  return status;
}

}  // namespace nadir
