#include "flight/view_builder.hpp"

#include <gtest/gtest.h>

#include "support/temporary_folder.hpp"

namespace nadir {
namespace {

LocalizedFrame localized(double captured_s, AnchorVerdict verdict) {
  LocalizedFrame frame;
  frame.telemetry.time_s = captured_s;
  frame.report.anchor.verdict = verdict;
  frame.report.estimate.position = LonLat{8.5, 47.4};
  frame.report.estimate.sigma_m = 4;
  frame.report.estimate.hpl_m = 22;
  frame.report.estimate.covariance_m2 << 9, 2, 2, 23;
  frame.report.estimate.source = SourceLabel::satellite_anchored;
  frame.report.estimate.anchor_age_s = 0.5;
  frame.report.state.velocity_mps = {3, -4};
  frame.report.state.agl_m = 120;
  return frame;
}

FlightView view_of(const ViewBuilder& views) { return views.view(20, 1'760'000'000'500'000, EventRing()); }

TEST(ViewBuilder, IsEmptyAtTheStart) {
  const FlightView view = view_of(ViewBuilder("b00"));
  EXPECT_EQ(view.boot_id, "b00");
  EXPECT_EQ(view.time_s, 20);
  EXPECT_EQ(view.utc->unix_s, 1'760'000'000);
  EXPECT_FALSE(view.position);
  EXPECT_TRUE(view.track.empty());
  EXPECT_EQ(view.gps.judgement, GpsJudgement::unknown);
}

TEST(ViewBuilder, ShowsThePositionWithItsUncertaintyWhileThereIsAFix) {
  ViewBuilder views("b");
  views.on_event(localized(10, AnchorVerdict::accepted));
  FlightView view = view_of(views);
  ASSERT_TRUE(view.position);
  EXPECT_EQ(view.position->place, (LonLat{8.5, 47.4}));
  EXPECT_EQ(view.position->sigma_m, 4);
  EXPECT_EQ(view.position->hpl_m, 22);
  ASSERT_TRUE(view.velocity);
  EXPECT_EQ(view.velocity->east_mps, 3);
  EXPECT_EQ(view.velocity->north_mps, -4);
  EXPECT_EQ(view.track.size(), 1U);
  LocalizedFrame lost = localized(11, AnchorVerdict::not_tried);
  lost.report.estimate.position.reset();
  lost.report.estimate.source = SourceLabel::no_fix;
  views.on_event(lost);
  view = view_of(views);
  EXPECT_FALSE(view.position);
  EXPECT_EQ(view.source, SourceLabel::no_fix);
  EXPECT_EQ(view.track.size(), 1U) << "where it was stays known";
}

TEST(ViewBuilder, WhileBlindShowsTheFixThatIsSentOrNothing) {
  ViewBuilder views("b");
  views.on_event(localized(10, AnchorVerdict::accepted));
  ServiceStatus status;
  status.state = ServiceState::normal;
  const Fix last_fix{.unix_us = 0, .place = {8.6, 47.5}, .sigma_m = 30, .velocity = GpsVelocity{1, 2, 0}};
  views.restrict_to_fix(status, last_fix, 19);
  EXPECT_EQ(view_of(views).position->place, (LonLat{8.5, 47.4})) << "pictures know better";
  status.state = ServiceState::degraded;
  status.hpl_m = 150;
  views.restrict_to_fix(status, last_fix, 20);
  FlightView view = view_of(views);
  ASSERT_TRUE(view.position);
  EXPECT_EQ(view.position->place, (LonLat{8.6, 47.5}));
  EXPECT_EQ(view.position->sigma_m, 30);
  EXPECT_EQ(view.position->hpl_m, 150) << "as the service says that it has grown, not that of the last frame";
  EXPECT_EQ(view.position->east_var_m2, 900);
  EXPECT_EQ(view.velocity->east_mps, 2);
  EXPECT_EQ(view.source, SourceLabel::dead_reckoned);
  EXPECT_FALSE(view.heading_rad) << "the last frame's is old, and the autopilot has not sent one";
  EXPECT_FALSE(view.agl_m) << "so is its height";
  EXPECT_EQ(view.track.size(), 2U);
  for (const ServiceState state : {ServiceState::no_fix, ServiceState::failsafe, ServiceState::relocalizing}) {
    status.state = state;
    views.on_event(localized(21, AnchorVerdict::accepted));
    views.restrict_to_fix(status, last_fix, 21);
    EXPECT_FALSE(view_of(views).position);
    EXPECT_EQ(view_of(views).source, SourceLabel::no_fix);
  }
}

// Blind for ten seconds: nothing on the screen may stand still as if it were of now.
TEST(ViewBuilder, WhileBlindAgesCountFromTheClockAndTheHeadingIsTheAutopilots) {
  ViewBuilder views("b");
  views.on_event(localized(10, AnchorVerdict::accepted));  // matched 0.5 s before its capture
  EXPECT_EQ(view_of(views).anchored_s, 9.5) << "10.5 s ago, not 0.5";
  ServiceStatus status;
  status.state = ServiceState::degraded;
  status.frame_s = 10.1;
  AutopilotLink::State link;
  link.last_message_s = 19.9;
  link.attitude = AircraftAttitude{.roll_rad = 0.1, .pitch_rad = 0.2, .yaw_rad = 1.2};
  link.attitude_s = 19.9;
  views.set_status(status, "no frames from the camera: no frame for 9.90 s");
  views.set_link(link, true, true);
  views.restrict_to_fix(status, Fix{.unix_us = 0, .place = {8.6, 47.5}, .sigma_m = 30}, 20);
  FlightView view = view_of(views);
  EXPECT_EQ(view.anchored_s, 9.5);
  EXPECT_EQ(view.frames.last_s, 10.1);
  EXPECT_EQ(view.link.last_message_s, 19.9);
  EXPECT_EQ(view.heading_rad, 1.2);
  EXPECT_EQ(view.pitch_rad, 0.2);
  EXPECT_EQ(view.roll_rad, 0.1);
  views.restrict_to_fix(status, Fix{}, 25);
  EXPECT_FALSE(view_of(views).heading_rad) << "an autopilot that is silent for 5 s has no heading of now";
  LocalizedFrame lost = localized(30, AnchorVerdict::not_tried);
  lost.report.estimate.anchor_age_s.reset();
  views.on_event(lost);
  EXPECT_EQ(view_of(views).anchored_s, 9.5) << "the time since the last match goes on when tracking is lost";
}

TEST(ViewBuilder, CountsFailedMatchesAndCorruptTiles) {
  ViewBuilder views("b");
  views.on_event(MatchFailed{"out of memory"});
  views.on_event(MatchFailed{"out of memory"});
  views.on_event(TileCorrupt{{17, 1, 2}, "artifact.hash", "other bytes"});
  EXPECT_EQ(view_of(views).anchors.failed, 2U);
  EXPECT_EQ(view_of(views).anchors.rejected, 0U);
  EXPECT_EQ(view_of(views).package.corrupt_tiles, 1U);
}

TEST(ViewBuilder, CountsAnchorsByVerdict) {
  ViewBuilder views("b");
  for (const AnchorVerdict verdict : {AnchorVerdict::accepted, AnchorVerdict::ambiguous, AnchorVerdict::not_tried,
                                      AnchorVerdict::ambiguous, AnchorVerdict::few_inliers}) {
    views.on_event(localized(10, verdict));
  }
  const FlightView view = view_of(views);
  EXPECT_EQ(view.anchors.accepted, 1U);
  EXPECT_EQ(view.anchors.rejected, 3U);
  EXPECT_EQ(view.anchors.rejected_by.at("ambiguous"), 2U);
  EXPECT_EQ(view.anchors.rejected_by.at("few_inliers"), 1U);
}

TEST(ViewBuilder, CountsFramesAndTheirRecentRate) {
  ViewBuilder views("b");
  views.set_frames({.put = 0, .taken = 0, .dropped = 0}, 100);
  views.set_frames({.put = 6, .taken = 5, .dropped = 1}, 101);
  EXPECT_EQ(view_of(views).frames.received, 6U);
  EXPECT_EQ(view_of(views).frames.dropped, 1U);
  EXPECT_EQ(view_of(views).frames.per_s, 0) << "one second is too short to tell";
  views.set_frames({.put = 12, .taken = 11, .dropped = 1}, 102);
  EXPECT_EQ(view_of(views).frames.per_s, 6);
}

TEST(ViewBuilder, ShowsWhyTheRecorderFailedAndHowMuchItWrote) {
  ViewBuilder views("b");
  views.set_recorder(nullptr, "");
  EXPECT_EQ(view_of(views).recorder.state, RecorderState::off);
  views.set_recorder(nullptr, "no such folder");
  EXPECT_EQ(view_of(views).recorder.state, RecorderState::failed);
  EXPECT_EQ(view_of(views).recorder.reason, "no such folder");
  const test::TemporaryFolder folder;
  RecorderOptions options;
  options.store.folder = folder / "r";
  options.store.sync = false;
  Recorder recorder(options, {}, [] { return std::uint64_t{1}; });
  recorder.flush();
  views.set_recorder(&recorder, "");
  EXPECT_EQ(view_of(views).recorder.state, RecorderState::recording);
  EXPECT_EQ(view_of(views).recorder.lost_records, 0U);
  EXPECT_GT(view_of(views).recorder.free_bytes, 0U);
}

TEST(ViewBuilder, CountsRejectedFramesOfTheLink) {
  AutopilotLink::State state;
  state.fixes_sent = 12;
  state.counts.malformed = 2;
  state.counts.signatures.wrong = 3;
  ViewBuilder views("b");
  state.error = "serial:/dev/ttyAMA0:921600: Device or resource busy";
  views.set_link(state, false, true);
  EXPECT_EQ(view_of(views).link.reason, state.error);
  state.error.clear();
  views.set_link(state, false, true);
  EXPECT_EQ(view_of(views).link.reason, "no heartbeat with a valid signature");
  views.set_link(state, true, true);
  EXPECT_EQ(view_of(views).link.reason, "");
  const FlightView view = view_of(views);
  EXPECT_TRUE(view.link.connected);
  EXPECT_TRUE(view.link.signed_frames);
  EXPECT_EQ(view.link.fixes_sent, 12U);
  EXPECT_EQ(view.link.rejected_by.at("malformed"), 2U);
  EXPECT_EQ(view.link.rejected_by.at("wrong_signature"), 3U);
  EXPECT_EQ(view.link.rejected_by.at("replayed"), 0U);
}

TEST(ViewBuilder, ShowsStateAndGps) {
  ViewBuilder views("b");
  for (const ServiceState state : {ServiceState::normal, ServiceState::no_fix, ServiceState::failsafe}) {
    ServiceStatus status;
    status.state = state;
    status.since_s = 7;
    views.set_status(status, "because");
    EXPECT_EQ(view_of(views).state.state, state);
    EXPECT_EQ(view_of(views).state.reason, "because");
  }
  for (const auto& [verdict, shown] : {std::pair{GpsVerdict::trusted, GpsJudgement::good},
                                       {GpsVerdict::denied, GpsJudgement::denied},
                                       {GpsVerdict::spoofed, GpsJudgement::spoofed},
                                       {GpsVerdict::unknown, GpsJudgement::unknown}}) {
    GpsAssessment assessment;
    assessment.verdict = verdict;
    views.on_event(assessment);
    EXPECT_EQ(view_of(views).gps.judgement, shown);
  }
}

TEST(ViewBuilder, ShowsWhatTheMissionDemandsAndWhetherItIsMet) {
  ViewBuilder views("b");
  EXPECT_FALSE(view_of(views).integrity.usable);
  views.set_integrity({.risk = 1e-7, .alert_limit_m = 40, .time_to_alert_s = 6});
  ServiceStatus status;
  status.usable = true;
  views.set_status(status, "");
  const IntegrityView shown = view_of(views).integrity;
  EXPECT_TRUE(shown.usable);
  EXPECT_EQ(shown.risk, 1e-7);
  EXPECT_EQ(shown.alert_limit_m, 40);
  EXPECT_EQ(shown.time_to_alert_s, 6);
}

}  // namespace
}  // namespace nadir
