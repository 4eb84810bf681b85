// A recorded flight on the page: what it shows, and that a moment is the same however it was reached.
#include "flight/playback.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <future>
#include <nlohmann/json.hpp>
#include <thread>

#include "api/view_formats.hpp"
#include "base/error.hpp"
#include "base/files.hpp"
#include "flight/recorded_circle.hpp"
#include "package/package_maker.hpp"
#include "support/temporary_folder.hpp"

namespace nadir {
namespace {

using testing::Contains;
using testing::HasSubstr;

class PlaybackTest : public ::testing::Test {
 protected:
  std::filesystem::path recording() const { return folder_ / "record"; }
  std::unique_ptr<Playback> open(PlaybackSource source = {}) {
    if (source.recording.empty()) source.recording = recording();
    return std::make_unique<Playback>(source, "run", silent_);
  }
  std::string refusal(const PlaybackSource& source) {
    try {
      open(source);
    } catch (const Error& error) {
      return error.what();
    }
    return "none";
  }
  static FlightView at(Playback& playback, double time_s) {
    playback.control({.playing = false, .at_s = time_s});
    playback.advance(0);
    return playback.view();
  }
  // All that a reader gets, but for the names of run and view and for what is asked for.
  static std::string text_of(const FlightView& view) {
    nlohmann::json all = state_json(view, 0);
    for (const char* name : {"boot", "version", "playback"}) all.erase(name);
    for (const FlightEvent& event : view.events) all["events"].push_back(event_json(event, view, 0));
    for (const FlightEvent& event : view.alarms) all["alarms"].push_back(event_json(event, view, 0));
    all["track"] = track_json(view);
    return all.dump(1);
  }
  static std::vector<std::string> texts(const std::vector<FlightEvent>& events) {
    std::vector<std::string> all;
    for (const FlightEvent& event : events) all.push_back(event.kind + ": " + event.text);
    return all;
  }
  std::string digests() const {
    std::string all;
    for (const Segment& segment : segments_in(recording()))
      all += segment.path.filename().string() + sha256_file(segment.path).hex();
    return all;
  }

  const test::TemporaryFolder folder_;
  test::RecordedCircle circle_;
  NoProgress silent_;
};

TEST_F(PlaybackTest, ShowsAMomentAsItWas) {
  circle_.record(recording());
  const auto playback = open();
  FlightView view = at(*playback, 25);
  EXPECT_EQ(view.state.state, ServiceState::normal);
  EXPECT_EQ(view.state.reason, "first map match");
  EXPECT_DOUBLE_EQ(view.state.since_s, 3);
  EXPECT_EQ(view.utc->unix_s, circle_.start_unix_s + 25) << "of the flight, not of today";
  ASSERT_TRUE(view.position);
  const auto apart_m = [&](double time_s) {
    const PlanePoint apart = LocalFrame(circle_.place(time_s)).plane_from_lonlat(view.position->place);
    return std::hypot(apart.east_m, apart.north_m);
  };
  EXPECT_LT(apart_m(24.9), 0.01) << "the last frame";
  EXPECT_EQ(view.position->hpl_m, 22);
  EXPECT_TRUE(view.integrity.usable);
  EXPECT_NEAR(*view.roll_rad, 0.3, 1e-9);
  EXPECT_EQ(view.frames.received, 84);
  EXPECT_NEAR(view.frames.per_s, 3.3, 0.3);
  EXPECT_EQ(view.anchors.accepted, 11);
  EXPECT_EQ(view.anchors.rejected_by.at("ambiguous"), 10);
  EXPECT_TRUE(view.link.connected && view.link.signed_frames);
  EXPECT_EQ(view.link.fixes_sent, 221);
  EXPECT_EQ(view.gps.judgement, GpsJudgement::spoofed);
  EXPECT_EQ(view.gps.reason, "80 m from vision");
  EXPECT_EQ(view.track.size(), 22) << "each fourth frame, and the aircraft";
  EXPECT_EQ(view.events.back().text, "another sender claims to be the autopilot");
  EXPECT_THAT(texts(view.alarms), testing::ElementsAre("state: GPS is spoofed: 80 m from vision",
                                                       "link: another sender claims to be the autopilot"));
  ASSERT_TRUE(view.playback);
  EXPECT_EQ(view.playback->session, circle_.session);
  EXPECT_EQ(view.playback->recorded->unix_s, circle_.start_unix_s);
  EXPECT_EQ(view.playback->length_s, 60);
  EXPECT_EQ(view.playback->notice, "");

  view = at(*playback, 35);
  EXPECT_EQ(view.state.state, ServiceState::degraded);
  EXPECT_LT(apart_m(35), 0.01) << "what was sent";
  EXPECT_EQ(view.position->sigma_m, 31);
  EXPECT_EQ(view.source, SourceLabel::dead_reckoned);
  EXPECT_NEAR(*view.heading_rad, 2.5, 1e-6) << "the autopilot's own";
  EXPECT_NEAR(*view.frames.last_s, 29.7, 1e-6);
  EXPECT_TRUE(view.integrity.usable) << "no alert was recorded";

  view = at(*playback, 0.6);
  EXPECT_EQ(view.state.state, ServiceState::awaiting_autopilot);
  EXPECT_FALSE(view.link.connected);
  EXPECT_EQ(view.events.size(), 1);
}

TEST_F(PlaybackTest, AMomentIsTheSameHoweverItIsReached) {
  circle_.record(recording());
  const std::string before = digests();
  std::map<double, std::string> played;
  const auto playback = open();
  playback->control({.speed = 4});
  while (playback->view().playback->playing) {
    const FlightView view = playback->view();
    played.emplace(view.time_s, text_of(view));
    playback->advance(0.37);
  }
  EXPECT_EQ(playback->view().time_s, 60) << "it pauses at the end";
  ASSERT_GT(played.size(), 30);
  const auto again = open();
  for (const auto& [time_s, text] : played) EXPECT_EQ(text_of(at(*again, time_s)), text) << "on, " << time_s;
  for (auto one = played.rbegin(); one != played.rend(); ++one)
    EXPECT_EQ(text_of(at(*again, one->first)), one->second) << "back, " << one->first;
  EXPECT_EQ(digests(), before) << "the recording is only read";
}

TEST_F(PlaybackTest, PlaysPausesAndJumps) {
  circle_.record(recording());
  const auto playback = open();
  EXPECT_TRUE(playback->view().playback->playing) << "from its beginning";
  playback->advance(2);
  EXPECT_NEAR(playback->view().time_s, 2, 1e-9);
  playback->control({.playing = false});
  playback->advance(5);
  EXPECT_NEAR(playback->view().time_s, 2, 1e-9);
  const std::string run = playback->view().boot_id;
  playback->control({.playing = true, .speed = 16});
  playback->advance(0.5);
  EXPECT_NEAR(playback->view().time_s, 10, 1e-9);
  EXPECT_EQ(playback->view().boot_id, run);
  const PlaybackView asked = playback->control({.at_s = 4.11});
  EXPECT_NEAR(asked.at_s, 4.2, 1e-9) << "the answer is what will be shown";
  playback->advance(0.5);
  EXPECT_NEAR(playback->view().time_s, 4.2, 1e-9);
  EXPECT_NE(playback->view().boot_id, run) << "readers must forget what they showed";
  playback->advance(100);
  EXPECT_EQ(playback->view().time_s, 60);
  EXPECT_FALSE(playback->view().playback->playing);
  playback->control({.playing = true});
  playback->advance(0);
  EXPECT_EQ(playback->view().time_s, 0) << "once more";
}

TEST_F(PlaybackTest, ATruncatedRecordingIsPlayedAsFarAsItCanBeRead) {
  circle_.clean_end = false;
  circle_.length_s = 600;
  circle_.record(recording());
  const std::filesystem::path file = segments_in(recording()).front().path;
  std::filesystem::resize_file(file, std::filesystem::file_size(file) * 6 / 10);
  const auto playback = open();
  EXPECT_THAT(playback->notice(), HasSubstr("recorder.truncated"));
  EXPECT_THAT(playback->notice(), HasSubstr("recorder.unclean"));
  const FlightView end = at(*playback, playback->view().playback->length_s);
  EXPECT_GT(end.time_s, 60);
  EXPECT_LT(end.time_s, 580);
  EXPECT_TRUE(end.position);
}

TEST_F(PlaybackTest, TheNewestSessionUnlessAnotherIsNamed) {
  circle_.record(recording());
  test::RecordedCircle later{.session = "mini-07-later", .start_unix_s = 1'770'000'000};
  later.record(recording());
  EXPECT_EQ(open()->view().playback->session, "mini-07-later");
  EXPECT_EQ(at(*open({.session = circle_.session}), 5).utc->unix_s, circle_.start_unix_s + 5);
  EXPECT_THAT(refusal({.recording = recording(), .session = "another"}), HasSubstr("mini-07-later"));
}

TEST_F(PlaybackTest, WhatCannotBePlayedIsRefused) {
  EXPECT_THAT(refusal({.recording = folder_ / "nowhere"}), HasSubstr("nowhere"));
  std::filesystem::create_directories(folder_ / "empty");
  EXPECT_THAT(refusal({.recording = folder_ / "empty"}), HasSubstr("contains no recording"));
  EXPECT_THAT(refusal({.recording = folder_.write("text.mcap", "no recording")}), HasSubstr("text.mcap"));
  circle_.estimates = false;
  circle_.record(recording());
  EXPECT_THAT(refusal({.recording = recording()}), HasSubstr("has no estimates"));
}

TEST_F(PlaybackTest, ARecordingWithoutStatesFollowsTheEstimates) {
  circle_.states = false;
  circle_.record(recording());
  const FlightView view = at(*open(), 20);
  EXPECT_EQ(view.state.state, ServiceState::normal);
  EXPECT_THAT(view.state.reason, HasSubstr("a replay"));
  EXPECT_FALSE(view.link.signed_frames);
}

TEST_F(PlaybackTest, OnlyTheFlownPackageIsItsMap) {
  test::PackageMaker maker;
  const std::filesystem::path flown = maker.make(folder_, "flown"), other = [&] {
    test::PackageMaker later;
    later.mission = test::mission_yaml({{"sequence: 3", "sequence: 4"}});
    return later.make(folder_, "other");
  }();
  circle_.package = sha256_file(flown / kManifestFile);
  circle_.record(recording());
  EXPECT_FALSE(open()->view().package.accepted);
  EXPECT_EQ(open()->for_api().tiles, nullptr);
  EXPECT_THAT(refusal({.recording = recording(), .package = other}), HasSubstr("not the package that was flown"));
  const auto playback = open({.package = flown});
  EXPECT_TRUE(playback->view().package.accepted);
  EXPECT_EQ(playback->view().package.mission, "village-a");
  EXPECT_NE(playback->for_api().tiles, nullptr);
  std::filesystem::remove(flown / kImageryFile);
  EXPECT_THAT(refusal({.recording = recording(), .package = flown}), HasSubstr("not whole"));
}

TEST_F(PlaybackTest, ThePageIsServedUntilItIsStopped) {
  circle_.record(recording());
  const auto playback = open();
  const SystemFlightClock clock;
  std::promise<std::uint16_t> port;
  std::jthread served([&](const std::stop_token& stop) {
    serve_playback(*playback, {"127.0.0.1:0", std::nullopt}, clock, stop,
                   [&](std::uint16_t listening) { port.set_value(listening); });
  });
  EXPECT_GT(port.get_future().get(), 0);
  served.request_stop();
}

}  // namespace
}  // namespace nadir
