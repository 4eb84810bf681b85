#include "api/metrics.hpp"

#include <fmt/format.h>

#include <cmath>
#include <initializer_list>
#include <iterator>

#include "base/printable.hpp"

namespace nadir {
namespace {

// The label's value may hold anything: backslash, quote and line end are escaped.
std::string escaped(std::string_view value) {
  std::string text;
  for (const char c : printable(value)) {
    if (c == '\n') {
      text += "\\n";
      continue;
    }
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

class Text {
 public:
  void gauge(std::string_view name, std::string_view help, double value) {
    head(name, help, "gauge");
    line(name, {}, shown(value));
  }
  // Absent when it is not known: a number in its place would be drawn.
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

std::optional<double> sigma_of(const FlightView& view) {
  return view.position ? std::optional(view.position->sigma_m) : std::nullopt;
}

}  // namespace

std::string metrics_text(const FlightView& view, double age_s, const ServerCounts& server) {
  Text text;
  text.gauge("view_age_seconds", "Age of what the flight's thread said last.", age_s);
  text.one_of("state", "State of the service.", name_of(view.state.state),
              {"boot", "no_package", "awaiting_autopilot", "relocalizing", "normal", "degraded", "no_fix", "failsafe"},
              "state");
  text.one_of("source", "Where the position comes from.", name_of(view.source),
              {"satellite_anchored", "vo_extrapolated", "dead_reckoned", "no_fix"}, "source");
  text.gauge("position_sigma_meters", "One sigma of the position, one axis.", sigma_of(view));
  text.gauge("anchor_age_seconds", "Since the last accepted anchor.", view.anchor_age_s);
  text.gauge("agl_meters", "Height above ground.", view.agl_m);
  text.counter("frames_received_total", "Frames from the camera.", view.frames.received);
  text.counter("frames_dropped_total",
               "Frames that were not followed: a newer one came, or the camera had held it back.", view.frames.dropped);
  text.gauge("frames_per_second", "Rate of frames.", view.frames.per_s);
  text.counter("anchors_accepted_total", "Accepted anchors.", view.anchors.accepted);
  text.counter("anchors_rejected_total", "Rejected anchors.", view.anchors.rejected);
  text.counters("anchors_rejected_by_total", "Rejected anchors by gate.", view.anchors.rejected_by);
  text.gauge("link_connected", "Whether the autopilot is heard.", view.link.connected ? 1.0 : 0.0);
  text.gauge("link_signed", "Whether its frames are signed.", view.link.signed_frames ? 1.0 : 0.0);
  text.counter("fixes_sent_total", "Positions sent to the autopilot.", view.link.fixes_sent);
  text.counters("link_frames_rejected_total", "Frames that were not believed.", view.link.rejected_by);
  text.one_of("gps", "Judgement of the autopilot's GPS.", name_of(view.gps.judgement),
              {"unknown", "good", "denied", "spoofed"}, "judgement");
  text.one_of("recorder", "State of the flight recorder.", name_of(view.recorder.state),
              {"off", "recording", "limited", "failed"}, "state");
  text.counter("recorder_written_bytes_total", "Written by the recorder.", view.recorder.written_bytes);
  text.counter("recorder_lost_records_total", "Records that it could not keep.", view.recorder.lost_records);
  text.gauge("package_accepted", "Whether the map package was verified.", view.package.accepted ? 1.0 : 0.0);
  text.gauge("api_connections", "Open connections.", static_cast<double>(server.connections_open));
  text.counter("api_connections_total", "Accepted connections.", server.connections_total);
  text.counter("api_connections_refused_total", "Connections beyond the limit.", server.connections_refused);
  text.counter("api_requests_total", "Answered requests.", server.requests_total);
  text.gauge("api_streams", "Open event streams.", static_cast<double>(server.streams_open));
  text.counter("api_streams_refused_total", "Event streams beyond the limit.", server.streams_refused);
  text.counter("api_streams_dropped_total", "Event streams that did not read.", server.streams_dropped);
  return text.take();
}

}  // namespace nadir
