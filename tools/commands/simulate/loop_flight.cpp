#include "commands/simulate/loop_flight.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <fstream>
#include <mutex>
#include <ostream>
#include <thread>

#include "base/error.hpp"
#include "cli/terminal.hpp"
#include "nadird_client/nadird_client.hpp"

namespace nadir {
namespace {

using LoopClock = std::chrono::steady_clock;

constexpr double kGpsFails_s = 60, kDark_s = 15;
constexpr int kStepsPerRow = 5, kStepsPerLine = 500;  // 0.1 s, 10 s
const Eigen::Vector2d kSpoofedBy_m(282, 103);         // 300 m
constexpr double kFallsBehind_s = 1, kPollPeriod_s = 0.25, kPollStale_s = 1.5;

// What nadird says of itself, asked a few times a second.
class StatusPoll {
 public:
  explicit StatusPoll(const std::string& page)
      : client_(page, {}, std::chrono::seconds(2)), thread_([this](const std::stop_token& stop) { run(stop); }) {}

  // nullopt: no answer lately.
  std::optional<WatchedStatus> latest() const {
    const std::scoped_lock lock(mutex_);
    if (LoopClock::now() - at_ > std::chrono::duration<double>(kPollStale_s)) return std::nullopt;
    return status_;
  }

 private:
  void run(const std::stop_token& stop) {
    while (!stop.stop_requested()) {
      try {
        WatchedStatus status = parse_watched_status(client_.get("/v1/state"));
        const std::scoped_lock lock(mutex_);
        status_ = std::move(status);
        at_ = LoopClock::now();
      } catch (const Error&) {
        // latest() becomes nullopt
      }
      std::this_thread::sleep_for(std::chrono::duration<double>(kPollPeriod_s));
    }
  }

  NadirdClient client_;
  mutable std::mutex mutex_;
  std::optional<WatchedStatus> status_;
  LoopClock::time_point at_{};
  std::jthread thread_;  // last: it uses everything above
};

std::optional<Spread> spread_of(std::vector<double> values) {
  if (values.empty()) return std::nullopt;
  std::ranges::sort(values);
  const auto at = [&](double share) {
    return values[static_cast<std::size_t>(share * static_cast<double>(values.size() - 1))];
  };
  return Spread{at(0.5), at(0.95), values.back()};
}

std::string flight_clock(double seconds) {
  const auto whole = static_cast<int>(seconds);
  return fmt::format("{}:{:02}", whole / 60, whole % 60);
}

std::int64_t unix_now_us() {
  return std::chrono::duration_cast<std::chrono::microseconds>(std::chrono::system_clock::now().time_since_epoch())
      .count();
}

// Rows of the truth beside what nadird gave.
class TrackFile {
 public:
  explicit TrackFile(const std::filesystem::path& path) : path_(path), file_(path) {
    file_ << "time_s,lon_deg,lat_deg,off_track_m,fix_lon_deg,fix_lat_deg,fix_error_m,fix_sigma_m,flown_by,usable\n";
  }
  void row(const std::string& text) {
    file_ << text << '\n';
    if (!file_) throw Error({.what = "cannot write", .where = path_.string(), .fix = "make room on the disk"});
  }

 private:
  std::filesystem::path path_;
  std::ofstream file_;
};

class LoopFlight {
 public:
  LoopFlight(const LoopFlightSetup& setup, SimulatedAircraft& aircraft, LoopAutopilot& autopilot,
             const LocalFrame& frame, Context& context)
      : setup_(setup),
        aircraft_(aircraft),
        autopilot_(autopilot),
        frame_(frame),
        context_(context),
        poll_(setup.page),
        track_(setup.track) {}

  LoopFigures fly() {
    const auto begun = LoopClock::now();
    while (aircraft_.now_s() < setup_.duration_s && !interrupt_requested()) {
      aircraft_.step();
      happen();
      autopilot_.turn(unix_now_us(), !dark_);
      note();
      const double ahead_s = aircraft_.now_s() - std::chrono::duration<double>(LoopClock::now() - begun).count();
      if (ahead_s > 0) std::this_thread::sleep_for(std::chrono::duration<double>(ahead_s));
      // An aircraft does not wait for a computer: what was missed is flown at once. Were it to stand still instead, a
      // position that was propagated meanwhile would be wrong.
      behind_ = ahead_s < -kFallsBehind_s;
      if (behind_) figures_.late_s = std::max(figures_.late_s, -ahead_s);
    }
    figures_.flown_s = aircraft_.now_s();
    figures_.lap_m = aircraft_.circuit().length_m();
    figures_.fixes = fix_errors_m_.size();
    figures_.fix_error_m = spread_of(std::move(fix_errors_m_));
    figures_.off_track_m = spread_of(std::move(off_track_m_));
    return figures_;
  }

 private:
  void say(const std::string& text) {
    if (!context_.quiet) context_.err << fmt::format("{:>6}  {}", flight_clock(aircraft_.now_s()), text) << std::endl;
  }

  void happen() {
    const Circumstance& c = setup_.circumstance;
    const double now_s = aircraft_.now_s();
    if (!gps_failed_ && now_s >= c.gps_fails_s) {
      gps_failed_ = true;
      if (c.spoofed) aircraft_.move_gps(kSpoofedBy_m);
      if (!c.spoofed) aircraft_.deny_gps();
      say(c.spoofed ? "GPS SPOOFED: it says 300 m from where the aircraft is" : "GPS DENIED");
    }
    const bool dark = c.dark_from_s && now_s >= *c.dark_from_s && now_s < *c.dark_to_s;
    if (dark != dark_) say(dark ? "NO FRAMES: the camera is dark" : "the camera sees again");
    dark_ = dark;
  }

  void note() {
    const double now_s = aircraft_.now_s();
    const PlanePoint here = aircraft_.body().place();
    for (const GivenPosition& given : autopilot_.take_given()) {
      if (behind_) continue;  // it is of a later moment than `here`
      given_ = given;
      fix_error_m_ = distance_m(given.place, here);
      given_s_ = now_s;
      fix_errors_m_.push_back(fix_error_m_);
    }
    for (const std::string& text : autopilot_.take_texts()) say("\"" + text + "\"");
    if (aircraft_.by_given_position()) figures_.by_fixes_s += SimulatedAircraft::kStep_s;
    if (++steps_ % kStepsPerRow == 0) {
      status_ = poll_.latest();
      off_track_m_.push_back(aircraft_.off_track_m());
      write_row();
      setup_.check();
    }
    const bool usable = status_ && status_->usable;
    if (usable && !figures_.usable_from_s) figures_.usable_from_s = now_s;
    if (figures_.usable_from_s && !usable) figures_.unusable_s += SimulatedAircraft::kStep_s;
    if (steps_ % kStepsPerLine == 0) say_progress();
  }

  bool has_fix() const { return given_s_ && aircraft_.now_s() - *given_s_ < 1; }

  void say_progress() {
    const std::string fix =
        has_fix() ? fmt::format("fix {:.1f} m off (σ {:.1f} m)", fix_error_m_, given_.sigma_m) : "no fix";
    const std::string state =
        status_ ? fmt::format("{}, GPS {}, {}usable", status_->state, status_->gps, status_->usable ? "" : "not ")
                : "nadird does not answer";
    say(fmt::format("{:<28} {:.1f} m from the plan; {}", fix, off_track_m_.back(), state));
  }

  void write_row() {
    const LonLat here = frame_.lonlat_from_plane(aircraft_.body().place());
    std::string fix = ",,,";
    if (has_fix()) {
      const LonLat place = frame_.lonlat_from_plane(given_.place);
      fix = fmt::format("{:.7f},{:.7f},{:.2f},{:.2f}", place.lon_deg, place.lat_deg, fix_error_m_, given_.sigma_m);
    }
    track_.row(fmt::format("{:.2f},{:.7f},{:.7f},{:.2f},{},{},{}", aircraft_.now_s(), here.lon_deg, here.lat_deg,
                           off_track_m_.back(), fix, aircraft_.by_given_position() ? "nadird" : "own",
                           status_ && status_->usable ? 1 : 0));
  }

  const LoopFlightSetup& setup_;
  SimulatedAircraft& aircraft_;
  LoopAutopilot& autopilot_;
  const LocalFrame& frame_;
  Context& context_;
  StatusPoll poll_;
  TrackFile track_;

  bool gps_failed_ = false, dark_ = false, behind_ = false;
  GivenPosition given_;
  int steps_ = 0;
  double fix_error_m_ = 0;
  std::optional<double> given_s_;
  std::optional<WatchedStatus> status_;
  std::vector<double> fix_errors_m_, off_track_m_;
  LoopFigures figures_;
};

}  // namespace

Circumstance circumstance(const std::string& name, double duration_s) {
  Circumstance c{.name = name, .gps_fails_s = std::min(kGpsFails_s, duration_s / 3), .spoofed = name == "spoofed"};
  if (name == "blackout") {
    c.dark_from_s = 2 * c.gps_fails_s;
    c.dark_to_s = *c.dark_from_s + std::min(kDark_s, c.gps_fails_s / 2);
  }
  return c;
}

LoopFigures fly_loop(const LoopFlightSetup& setup, SimulatedAircraft& aircraft, LoopAutopilot& autopilot,
                     const LocalFrame& frame, Context& context) {
  return LoopFlight(setup, aircraft, autopilot, frame, context).fly();
}

}  // namespace nadir
