// A flight of a minute as nadird records it, written by the recorder and the journal themselves: circles at 3 frames a
// second, GPS spoofed from second 20, the camera silent from 30 to 40, its autopilot on a signed link.
#pragma once

#include <atomic>
#include <cmath>
#include <filesystem>

#include "flight/flight_journal.hpp"
#include "geodesy/local_frame.hpp"
#include "recorder/recorder.hpp"

namespace nadir::test {

struct RecordedCircle {
  std::string session = "mini-07-circle";
  std::int64_t start_unix_s = 1'760'000'000;
  std::optional<Sha256> package{};
  LonLat centre{11, 48};
  bool estimates = true, states = true, clean_end = true;
  double length_s = 60;

  static constexpr double kSilent_s = 30, kBack_s = 40;  // the camera

  LonLat place(double time_s) const {
    return LocalFrame(centre).lonlat_from_plane({200 * std::sin(time_s / 10), 200 * std::cos(time_s / 10)});
  }

  void record(const std::filesystem::path& folder) const {
    std::atomic<std::uint64_t> now_ns{static_cast<std::uint64_t>(start_unix_s) * 1'000'000'000};
    RecorderOptions options{.store = {.folder = folder, .sync = false}, .when_full = WhenFull::wait};
    SessionRecord about;
    about.id = session;
    about.started_ns = now_ns;
    about.program = "nadird";
    about.airframe = "mini-07";
    about.mission = "village-a";
    about.package = package;
    about.origin = centre;
    Recorder recorder(options, about, [&] { return now_ns.load(); });
    FlightJournal journal(&recorder);
    for (int turn = 0; turn <= static_cast<int>(length_s * 10); ++turn) {
      const double time_s = turn / 10.0;
      now_ns =
          static_cast<std::uint64_t>(start_unix_s) * 1'000'000'000 + static_cast<std::uint64_t>(turn) * 100'000'000;
      if (states) record_events(turn, journal);
      const bool sees = time_s < kSilent_s || time_s >= kBack_s;
      if (turn % 3 == 0 && sees) record_frame_of(turn / 3, time_s, recorder);
      if (turn >= 30) record_fix_of(turn, time_s, recorder);
    }
    recorder.flush();
    if (clean_end) recorder.close("stopped");
  }

 private:
  static void record_events(int turn, FlightJournal& journal) {
    using enum ServiceState;
    const double time_s = turn / 10.0;
    const auto enter = [&](ServiceState from, ServiceState to, ServiceReason reason, const std::string& detail = {}) {
      std::string text(text_of(reason).explanation);
      if (!detail.empty()) text += ": " + detail;
      journal.on_event(time_s, StateTransition{time_s, from, to, reason, text});
    };
    if (turn == 1) enter(boot, awaiting_autopilot, ServiceReason::package_verified);
    if (turn == 10) enter(awaiting_autopilot, relocalizing, ServiceReason::link_authentic);
    if (turn == 30) enter(relocalizing, normal, ServiceReason::first_anchor);
    if (turn == 200) enter(normal, normal, ServiceReason::gps_spoofed, "80 m from vision");
    if (turn == 210) journal.note(time_s, EventSeverity::critical, "link", "another sender claims to be the autopilot");
    if (turn == 304) enter(normal, degraded, ServiceReason::camera_silent, "no frame for 0.4 s");
    if (turn == 401) enter(degraded, normal, ServiceReason::vision_back);
    if (turn == 450) journal.note(time_s, EventSeverity::info, "hint", "API: within 500 m of 48.00000, 11.00000");
  }

  void record_frame_of(int index, double time_s, Recorder& recorder) const {
    Telemetry telemetry;
    telemetry.time_s = 5000 + time_s;  // since the computer's start
    telemetry.pitch_rad = 0.02;
    telemetry.roll_rad = 0.3;
    const auto number = static_cast<std::uint64_t>(index);
    record_input(recorder, number, telemetry, as_bytes("frame"));
    if (!estimates) return;
    FrameReport report;
    report.estimate.time_s = telemetry.time_s;
    report.estimate.position = place(time_s);
    report.estimate.sigma_m = 4;
    report.estimate.hpl_m = 22;
    report.estimate.covariance_m2 << 16, 0, 0, 16;
    report.estimate.source = SourceLabel::vo_extrapolated;
    report.estimate.anchor_age_s = 0.5;
    report.state.heading_rad = 1;
    report.state.agl_m = 120;
    record_frame(recorder, number, report);
    if (index % 4 != 0) return;
    report.anchor.verdict = index % 8 == 0 ? AnchorVerdict::accepted : AnchorVerdict::ambiguous;
    report.estimate.source = SourceLabel::satellite_anchored;
    record_anchor(recorder, number, number, report);
  }

  void record_fix_of(int turn, double time_s, Recorder& recorder) const {
    FixInputRecord inputs;
    inputs.number = static_cast<std::uint64_t>(turn - 30);
    inputs.time_us = 5'000'000'000 + turn * 100'000;
    inputs.sent = true;
    inputs.inputs.push_back({inputs.time_us - 20'000, FixInputRecord::Attitude{0.1F, 0.2F, 2.5F}});
    recorder.record(inputs);
    FixRecord fix;
    fix.time_s = 5000 + time_s;
    fix.fix_type = 3;
    fix.source = SourceLabel::dead_reckoned;
    fix.place = place(time_s);
    fix.accuracy_m = 31;
    fix.north_mps = 5;
    fix.east_mps = 12;
    recorder.record(fix);
  }
};

}  // namespace nadir::test
