#include "nadird_client/watching.hpp"

#include <fmt/format.h>

#include <chrono>
#include <nlohmann/json.hpp>
#include <optional>
#include <ostream>
#include <thread>

#include "base/error.hpp"
#include "base/json.hpp"
#include "cli/command.hpp"
#include "cli/terminal.hpp"
#include "cli/output.hpp"
#include "nadird_client/status_text.hpp"

namespace nadir {
namespace {

using Steady = std::chrono::steady_clock;

constexpr const char* kPath = "/v1/state";
constexpr const char* kHome = "\x1b[H";
constexpr const char* kClearLine = "\x1b[K";
constexpr const char* kClearBelow = "\x1b[J";
constexpr const char* kOtherScreen = "\x1b[?1049h\x1b[?25l";
constexpr const char* kOwnScreen = "\x1b[?25h\x1b[?1049l";

// What was there before comes back, however this ends.
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
    if (form_ == WatchForm::screen && last_) draw(*last_, notice);
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

// Ends early when somebody interrupts.
void wait(double seconds) {
  constexpr std::chrono::milliseconds kLook(50);
  const auto end = Steady::now() + std::chrono::duration<double>(seconds);
  while (Steady::now() < end && !interrupt_requested()) std::this_thread::sleep_for(kLook);
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
  return status.stalled() || !status.lat_deg ? kRefused : kAccepted;
}

void keep_showing(const NadirdClient& service, std::ostream& out, WatchForm form, double interval_s) {
  std::string body = service.get(kPath);
  std::optional<Screen> screen;
  if (form == WatchForm::screen) screen.emplace(out);
  Shower shower(out, form);
  shower.show(body);
  auto heard = Steady::now();
  for (wait(interval_s); !interrupt_requested() && out; wait(interval_s)) {
    try {
      shower.show(service.get(kPath));
      heard = Steady::now();
    } catch (const Error& error) {
      shower.show_silence(std::chrono::duration<double>(Steady::now() - heard).count(), error.text().what);
    }
  }
}

}  // namespace nadir
