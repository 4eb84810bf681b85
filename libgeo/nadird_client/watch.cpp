#include "nadird_client/watch.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <nlohmann/json.hpp>
#include <optional>
#include <ostream>
#include <thread>

#include "base/error.hpp"
#include "base/json.hpp"
#include "cli/command.hpp"
#include "cli/output.hpp"
#include "cli/terminal.hpp"
#include "geodesy/mgrs.hpp"

namespace nadir {
namespace {

constexpr double kSilent_s = 2;  // a camera or an autopilot: then its silence is shown
constexpr std::size_t kShownAlarms = 6, kShownEvents = 12;
constexpr const char* kNormal = "\x1b[0m";

// Background and foreground: distinguishable in sunlight.
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
  return fmt::format("{:.6f}, {:.6f} ({})  {}", *status.lat_deg, *status.lon_deg, status.source,
                     mgrs_from_lonlat({*status.lon_deg, *status.lat_deg}));
}

std::string protection_of(const WatchedStatus& status) {
  if (!status.lat_deg) return "no position";
  const std::string level = known(status.hpl_m, "{:.1f} m", "no radius is known");
  return status.usable ? level : fmt::format("{}: NOT USABLE, alert limit {:.0f} m", level, status.alert_limit_m);
}

std::string short_duration(double seconds) {
  if (seconds < 100) return fmt::format("{:.0f} s", seconds);
  if (seconds < 6000) return fmt::format("{:.0f} min", seconds / 60);
  return fmt::format("{:.1f} h", seconds / 3600);
}

// A recording does not hold them.
std::string dropped_of(const WatchedStatus& status) {
  if (status.playback) return "dropped ones unknown";
  return fmt::format("{} of {} dropped", status.frames_dropped, status.frames_received);
}

std::string frames_of(const WatchedStatus& status) {
  std::string rate = fmt::format("{:.1f} per s", status.frames_per_s);
  if (status.frame_age_s && *status.frame_age_s > kSilent_s) rate = "NONE for " + short_duration(*status.frame_age_s);
  return rate + ", " + dropped_of(status);
}

std::string anchors_of(const WatchedStatus& status) {
  const std::string failed = status.anchors_failed > 0 ? fmt::format(", {} FAILED", status.anchors_failed) : "";
  return fmt::format("{} accepted, {} rejected{}", status.anchors_accepted, status.anchors_rejected, failed);
}

std::string height_of(const WatchedStatus& status) {
  constexpr double kMetresPerFoot = 0.3048;
  if (!status.agl_m) return known(status.agl_m, "");
  return fmt::format("{:.0f} m ({:.0f} ft) above ground", *status.agl_m, *status.agl_m / kMetresPerFoot);
}

std::string link_of(const WatchedStatus& status) {
  const bool silent = status.link_age_s && *status.link_age_s > kSilent_s;
  return fmt::format("{}, {}, {} fixes sent, {} frames rejected{}",
                     status.link_connected        ? "connected"
                     : status.link_reason.empty() ? "not connected"
                                                  : fmt::format("not connected ({})", status.link_reason),
                     status.link_signed ? "signed" : "NOT SIGNED: anybody can pose as the autopilot", status.fixes_sent,
                     status.link_rejected, silent ? ", silent for " + short_duration(*status.link_age_s) : "");
}

std::string playback_of(const WatchedStatus& status) {
  return fmt::format("RECORDING{}: this is no flight", status.recorded.empty() ? "" : " of " + status.recorded);
}

std::string row(const char* name, const std::string& value) { return fmt::format("{:<12}{}", name, value); }

std::string event_line(const WatchedEvent& event) {
  const std::string repeats = event.count > 1 ? fmt::format(" (x {})", event.count) : "";
  return fmt::format("{:>7}  {:<8}  {}{}", short_duration(event.age_s), event.severity, event.text, repeats);
}

std::vector<std::string> status_screen(const WatchedStatus& status, bool colour) {
  std::string name = status.state;
  std::transform(name.begin(), name.end(), name.begin(), [](char c) {
    return c == '_' ? ' ' : c >= 'a' && c <= 'z' ? static_cast<char>(c - 32) : c;
  });
  const std::string head = colour ? fmt::format("{} {} {}", colour_of(status), name, kNormal) : name;
  std::vector<std::string> lines{
      fmt::format("{}  for {}  {}", head, short_duration(status.state_for_s), status.reason)};
  if (status.playback) lines.push_back(playback_of(status));
  if (status.stalled()) {
    lines.push_back(fmt::format("STALE: the flight thread has been silent for {}", short_duration(status.age_s)));
  }
  lines.insert(
      lines.end(),
      {"", row("position", position_of(status)), row("sigma", known(status.sigma_m, "{:.1f} m")),
       row("protection", protection_of(status)), row("anchor age", known(status.anchor_age_s, "{:.1f} s", "none yet")),
       row("speed", known(status.speed_mps, "{:.1f} m/s")), row("heading", known(status.heading_deg, "{:03.0f}°")),
       row("height", height_of(status)), "", row("frames", frames_of(status)), row("anchors", anchors_of(status)),
       row("autopilot", link_of(status)), row("GPS", with_reason(status.gps, status.gps_reason)),
       row("recorder", with_reason(status.recorder, status.recorder_reason))});
  if (status.corrupt_tiles > 0)
    lines.push_back(
        row("map", fmt::format("{} CORRUPT {}", status.corrupt_tiles, status.corrupt_tiles == 1 ? "TILE" : "TILES")));
  const auto list = [&](const char* title, const std::vector<WatchedEvent>& events, std::size_t most) {
    if (events.empty()) return;
    lines.insert(lines.end(), {"", title});
    const auto shown = static_cast<std::ptrdiff_t>(std::min(most, events.size()));
    std::for_each(events.rbegin(), events.rbegin() + shown,
                  [&](const WatchedEvent& event) { lines.push_back(event_line(event)); });
  };
  list("alarms", status.alarms, kShownAlarms);
  list("events", status.events, kShownEvents);
  return lines;
}

std::string status_line(const WatchedStatus& status) {
  return fmt::format(
      "{}{}{}, {}, sigma {}, protection level {}{}, anchor {}, {:.1f} frames/s ({}), anchors {} accepted, {} "
      "rejected, GPS {}, recorder {}",
      status.playback ? "RECORDING: " : "", status.stalled() ? "STALE: " : "", status.state, status.source,
      known(status.sigma_m, "{:.1f} m", "none"), known(status.hpl_m, "{:.1f} m", "none"),
      status.usable ? "" : " (NOT USABLE)", known(status.anchor_age_s, "{:.1f} s ago", "none"), status.frames_per_s,
      dropped_of(status), status.anchors_accepted, status.anchors_rejected, status.gps, status.recorder);
}

using Steady = std::chrono::steady_clock;

constexpr const char* kPath = "/v1/state";
constexpr const char* kHome = "\x1b[H";
constexpr const char* kClearLine = "\x1b[K";
constexpr const char* kClearBelow = "\x1b[J";
constexpr const char* kOtherScreen = "\x1b[?1049h\x1b[?25l";
constexpr const char* kOwnScreen = "\x1b[?25h\x1b[?1049l";

// Restores the previous screen, however this ends.
class Screen {
 public:
  explicit Screen(std::ostream& out) : out_(out) { out_ << kOtherScreen << std::flush; }
  ~Screen() { out_ << kOwnScreen << std::flush; }
  Screen(const Screen&) = delete;
  Screen& operator=(const Screen&) = delete;

 private:
  std::ostream& out_;
};

class Shower {
 public:
  Shower(std::ostream& out, WatchForm form) : out_(out), form_(form) {}

  void show(const std::string& body) {
    const WatchedStatus status = parse_watched_status(body);
    switch (form_) {
      case WatchForm::screen: draw(status, {}); break;
      case WatchForm::lines: write_lines(status); break;
      case WatchForm::json: out_ << parse_json(body, kPath).dump() << '\n'; break;
    }
    out_ << std::flush;
    if (status.boot != boot_) last_event_ = 0;
    boot_ = status.boot;
    if (!status.events.empty()) last_event_ = status.events.back().id;
    last_ = status;
  }

  void show_silence(double seconds, const std::string& why) {
    const std::string notice = fmt::format("NO CONTACT for {}: {}", short_duration(seconds), why);
    if (form_ == WatchForm::screen && last_) draw(aged(*last_, seconds), notice);
    if (form_ == WatchForm::lines) out_ << notice << '\n';
    if (form_ == WatchForm::json) out_ << nlohmann::json{{"contact", false}, {"silent_s", seconds}}.dump() << '\n';
    out_ << std::flush;
  }

 private:
  void draw(const WatchedStatus& status, const std::string& notice) {
    out_ << kHome;
    if (!notice.empty()) out_ << notice << kClearLine << "\r\n";
    for (const std::string& line : status_screen(status, notice.empty())) out_ << line << kClearLine << "\r\n";
    out_ << kClearBelow;
  }

  void write_lines(const WatchedStatus& status) {
    for (const WatchedEvent& event : status.events) {
      if (status.boot != boot_ || event.id > last_event_) out_ << "event  " << event_line(event) << '\n';
    }
    out_ << status_line(status) << '\n';
  }

  std::ostream& out_;
  WatchForm form_;
  std::string boot_;
  std::uint64_t last_event_ = 0;
  std::optional<WatchedStatus> last_;
};

// Ends early when interrupted.
void wait(double seconds) {
  constexpr std::chrono::milliseconds kPoll(50);
  const auto end = Steady::now() + std::chrono::duration<double>(seconds);
  while (Steady::now() < end && !interrupt_requested()) std::this_thread::sleep_for(kPoll);
}

}  // namespace

int show_once(const NadirdClient& service, std::ostream& out, bool as_json) {
  const std::string body = service.get(kPath);
  const WatchedStatus status = parse_watched_status(body);
  if (as_json) {
    print_json(out, parse_json(body, kPath));
  } else {
    for (const std::string& line : status_screen(status, false)) out << line << '\n';
  }
  return status.playback || status.stalled() || !status.lat_deg ? kRefused : kAccepted;
}

void keep_showing(const NadirdClient& service, std::ostream& out, WatchForm form, double interval_s) {
  std::string body = service.get(kPath);
  std::optional<Screen> screen;
  if (form == WatchForm::screen) screen.emplace(out);
  Shower shower(out, form);
  shower.show(body);
  auto last_contact = Steady::now();
  for (wait(interval_s); !interrupt_requested() && out; wait(interval_s)) {
    try {
      shower.show(service.get(kPath));
      last_contact = Steady::now();
    } catch (const Error& error) {
      shower.show_silence(std::chrono::duration<double>(Steady::now() - last_contact).count(), error.text().what);
    }
  }
}

}  // namespace nadir
