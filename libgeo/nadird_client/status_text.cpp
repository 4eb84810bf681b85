#include "nadird_client/status_text.hpp"

#include <fmt/format.h>

#include <algorithm>

namespace nadir {
namespace {

constexpr const char* kNormal = "\x1b[0m";

// Background and foreground: told apart in sunlight as well.
const char* colour_of(const WatchedStatus& status) {
  if (status.stalled() || status.state == "no_fix" || status.state == "failsafe" || status.state == "no_package")
    return "\x1b[1;97;41m";
  if (status.state == "normal") return "\x1b[1;30;42m";
  if (status.state == "degraded") return "\x1b[1;30;43m";
  return "\x1b[1;97;44m";
}

std::string known(const std::optional<double>& value, const char* format, const char* unknown = "not known") {
  return value ? fmt::format(fmt::runtime(format), *value) : unknown;
}

std::string with_reason(const std::string& what, const std::string& reason) {
  return reason.empty() ? what : what + ": " + reason;
}

std::string position_of(const WatchedStatus& status) {
  if (!status.lat_deg || !status.lon_deg) return "none";
  return fmt::format("{:.6f}, {:.6f} ({})", *status.lat_deg, *status.lon_deg, status.source);
}

std::string link_of(const WatchedStatus& status) {
  return fmt::format("{}, {}, {} fixes sent, {} frames rejected", status.link_connected ? "connected" : "not heard",
                     status.link_signed ? "signed" : "not signed", status.fixes_sent, status.link_rejected);
}

std::string row(const char* name, const std::string& value) { return fmt::format("{:<12}{}", name, value); }

}  // namespace

std::string short_duration(double seconds) {
  if (seconds < 100) return fmt::format("{:.0f} s", seconds);
  if (seconds < 6000) return fmt::format("{:.0f} min", seconds / 60);
  return fmt::format("{:.1f} h", seconds / 3600);
}

std::string event_line(const WatchedEvent& event) {
  return fmt::format("{:>7}  {:<8}  {}", short_duration(event.age_s), event.severity, event.text);
}

std::vector<std::string> status_screen(const WatchedStatus& status, bool colour, std::size_t most_events) {
  std::string name = status.state;
  std::transform(name.begin(), name.end(), name.begin(), [](char c) {
    return c == '_' ? ' ' : c >= 'a' && c <= 'z' ? static_cast<char>(c - 32) : c;
  });
  const std::string head = colour ? fmt::format("{} {} {}", colour_of(status), name, kNormal) : name;
  std::vector<std::string> lines{
      fmt::format("{}  for {}  {}", head, short_duration(status.state_for_s), status.reason)};
  if (status.stalled()) {
    lines.push_back(fmt::format("OLD: the flight's thread has been silent for {}", short_duration(status.age_s)));
  }
  lines.insert(
      lines.end(),
      {"", row("position", position_of(status)), row("sigma", known(status.sigma_m, "{:.1f} m")),
       row("anchor age", known(status.anchor_age_s, "{:.1f} s", "none yet")),
       row("speed", known(status.speed_mps, "{:.1f} m/s")), row("heading", known(status.heading_deg, "{:03.0f}°")),
       row("height", known(status.agl_m, "{:.0f} m above ground")), "",
       row("frames", fmt::format("{:.1f} per s, {} of {} dropped", status.frames_per_s, status.frames_dropped,
                                 status.frames_received)),
       row("anchors", fmt::format("{} accepted, {} rejected", status.anchors_accepted, status.anchors_rejected)),
       row("autopilot", link_of(status)), row("GPS", with_reason(status.gps, status.gps_reason)),
       row("recorder", with_reason(status.recorder, status.recorder_reason))});
  if (status.events.empty() || most_events == 0) return lines;
  lines.insert(lines.end(), {"", "events"});
  const std::size_t shown = std::min(most_events, status.events.size());
  std::for_each(status.events.rbegin(), status.events.rbegin() + static_cast<std::ptrdiff_t>(shown),
                [&](const WatchedEvent& event) { lines.push_back(event_line(event)); });
  return lines;
}

std::string status_line(const WatchedStatus& status) {
  return fmt::format("{}{}, {}, sigma {}, anchor {}, {:.1f} frames/s ({} dropped), anchors {}+{}-, GPS {}, recorder {}",
                     status.stalled() ? "OLD: " : "", status.state, status.source,
                     known(status.sigma_m, "{:.1f} m", "none"), known(status.anchor_age_s, "{:.1f} s ago", "none"),
                     status.frames_per_s, status.frames_dropped, status.anchors_accepted, status.anchors_rejected,
                     status.gps, status.recorder);
}

}  // namespace nadir
