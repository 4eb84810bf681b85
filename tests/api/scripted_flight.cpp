#include "api/scripted_flight.hpp"

#include <cmath>

#include "geodesy/angles.hpp"
#include "geodesy/local_frame.hpp"

namespace nadir::test {
namespace {

constexpr double kSpeed_mps = 22;
constexpr double kLastAnchorStep_s = 3;

struct Phase {
  SourceLabel source;
  double sigma_m;
  const char* reason;
  EventSeverity severity;
  GpsJudgement gps;
};

Phase phase_of(ServiceState state) {
  switch (state) {
    case ServiceState::boot:
      return {SourceLabel::no_fix, 0, "package is being verified", EventSeverity::info, GpsJudgement::unknown};
    case ServiceState::no_package:
      return {SourceLabel::no_fix, 0, "signature does not hold", EventSeverity::critical, GpsJudgement::unknown};
    case ServiceState::awaiting_autopilot:
      return {SourceLabel::no_fix, 0, "no signed heartbeat yet", EventSeverity::warning, GpsJudgement::unknown};
    case ServiceState::relocalizing:
      return {SourceLabel::no_fix, 0, "searching the mission's area", EventSeverity::info, GpsJudgement::denied};
    case ServiceState::normal:
      return {SourceLabel::satellite_anchored, 2.8, "anchored to the map", EventSeverity::info, GpsJudgement::spoofed};
    case ServiceState::degraded:
      return {SourceLabel::dead_reckoned, 38, "camera sees cloud, carried by velocity", EventSeverity::warning,
              GpsJudgement::denied};
    case ServiceState::no_fix:
      return {SourceLabel::no_fix, 0, "blind for more than 30 s", EventSeverity::critical, GpsJudgement::denied};
    case ServiceState::failsafe:
      return {SourceLabel::no_fix, 0, "no position for more than 3 s", EventSeverity::critical, GpsJudgement::denied};
  }
  return {};
}

}  // namespace

void ScriptedFlight::note(double time_s, EventSeverity severity, const std::string& kind, const std::string& text) {
  events_.add(time_s, severity, kind, text);
  if (severity == EventSeverity::critical) alarms_.add(time_s, severity, kind, text);
}

void ScriptedFlight::corrupt_tile(double time_s) {
  ++corrupt_tiles_;
  note(time_s, EventSeverity::critical, "tile",
       "artifact.hash: tile 17/70000/45000: bytes that differ from the signed ones");
}

void ScriptedFlight::note_change(double time_s, ServiceState state) {
  const Phase phase = phase_of(state);
  note(time_s, phase.severity, "state", std::string(name_of(state)) + ": " + phase.reason);
  if (phase.gps == GpsJudgement::spoofed) {
    note(time_s, EventSeverity::critical, "gps", "GPS judged spoofed: 312 m from vision; our position promoted");
  }
  state_ = state;
  since_s_ = time_s;
}

FlightView ScriptedFlight::at(double time_s, ServiceState state) {
  if (state != state_ || events_.events().empty()) note_change(time_s, state);
  const Phase phase = phase_of(state);
  const double turn_rad = time_s * kSpeed_mps / radius_m_;
  const LocalFrame frame(centre_);

  FlightView view;
  view.boot_id = "script";
  view.time_s = time_s;
  view.utc = UtcTime{1'730'764'800 + static_cast<std::int64_t>(time_s)};
  view.state = {state, phase.reason, since_s_};
  view.source = phase.source;
  view.gps = {phase.gps, phase.gps == GpsJudgement::spoofed ? "312 m from vision" : ""};
  view.heading_rad = wrap_pi(turn_rad + kPi / 2);
  view.pitch_rad = radians(2);
  view.roll_rad = radians(4);
  view.velocity = VelocityView{kSpeed_mps * std::cos(turn_rad), -kSpeed_mps * std::sin(turn_rad)};
  view.agl_m = 118 + 4 * std::sin(time_s / 7);
  if (phase.source != SourceLabel::no_fix) {
    const double sigma_m = phase.sigma_m;
    view.position =
        PositionView{frame.lonlat_from_plane({radius_m_ * std::sin(turn_rad), radius_m_ * std::cos(turn_rad)}),
                     sigma_m,
                     1.6 * sigma_m * sigma_m,
                     0.6 * sigma_m * sigma_m,
                     0.3 * sigma_m * sigma_m,
                     6.5 * sigma_m,
                     time_s};
    view.integrity.usable = *view.position->hpl_m <= view.integrity.alert_limit_m;
    view.anchored_s =
        phase.source == SourceLabel::satellite_anchored ? time_s - std::fmod(time_s, kLastAnchorStep_s) : since_s_ - 14;
    const bool fresh = phase.source == SourceLabel::satellite_anchored && std::fmod(time_s, 20) < 13;
    const SourceLabel carried =
        phase.source == SourceLabel::satellite_anchored && !fresh ? SourceLabel::vo_extrapolated : phase.source;
    view.source = carried;
    trail_.add({time_s, view.position->place, sigma_m, carried});
  }
  const auto frames = static_cast<std::uint64_t>(time_s * 3);
  view.frames = {frames, frames / 60, 3, state == ServiceState::degraded ? since_s_ : time_s};
  view.anchors = {frames / 9, frames / 40, 0, {{"ambiguous", frames / 60}, {"few_inliers", frames / 120}}};
  view.link.connected = state != ServiceState::awaiting_autopilot;
  if (!view.link.connected) view.link.reason = "serial:/dev/ttyAMA0:921600: Device or resource busy";
  view.link.signed_frames = link_signed_;
  view.link.last_message_s = time_s;
  view.link.fixes_sent = static_cast<std::uint64_t>(time_s * 10);
  view.link.rejected_by = {{"replay", 2}};
  view.link.stations = {{"ground station", "udpout:192.168.4.2:14550", true, 12, 1}};
  view.recorder = {RecorderState::recording, "", static_cast<std::uint64_t>(time_s * 41'000), 28'400'000'000, 0};
  view.package = {true,           "",   "valley",     "valley", 7, UtcTime{1'733'000'000}, 14, 18, 5120,
                  corrupt_tiles_, true, std::nullopt, {}};
  const double half_m = 2.5 * radius_m_;
  const LonLat south_west = frame.lonlat_from_plane({-half_m, -half_m}),
               north_east = frame.lonlat_from_plane({half_m, half_m});
  view.package.bounds = LonLatBox{south_west.lon_deg, south_west.lat_deg, north_east.lon_deg, north_east.lat_deg};
  for (int corner = 0; corner <= 32; ++corner) {
    const double angle = corner * 2 * kPi / 32;
    view.package.route.push_back(
        frame.lonlat_from_plane({1.04 * radius_m_ * std::sin(angle), 1.04 * radius_m_ * std::cos(angle)}));
  }
  view.events = events_.events();
  view.events_gone = events_.gone();
  view.alarms = alarms_.events();
  view.track = trail_.points();
  return view;
}

}  // namespace nadir::test
