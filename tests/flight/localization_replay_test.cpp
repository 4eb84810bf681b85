// The two threads of the localizer, recorded and flown again: whatever came between the pictures in the air comes
// between the same pictures in the replay, and every estimate has the same bits.
#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <chrono>
#include <cmath>
#include <condition_variable>
#include <thread>

#include "base/error.hpp"
#include "estimation/localizer_fixture.hpp"
#include "flight/localization_thread.hpp"
#include "geodesy/angles.hpp"
#include "imagery/codecs.hpp"
#include "recorder/recorder.hpp"
#include "replay/replay_flight.hpp"
#include "support/temporary_folder.hpp"

namespace nadir {
namespace {

using namespace test;

// Only so that what hangs fails; nothing waits for so long.
constexpr std::chrono::seconds kReplayLimit{120};

// The map, behind a gate: a look at it ends when the test says so.
class GatedTiles final : public TileSource {
 public:
  ZoomRange zooms() const override { return landscape_tiles().zooms(); }
  std::optional<Bytes> read(const TileKey& key) const override {
    std::unique_lock lock(mutex_);
    changed_.wait_for(lock, kReplayLimit, [&] { return open_; });
    if (broken_) throw Error({.what = "the disk is gone"});
    return landscape_tiles().read(key);
  }

  void open(bool broken = false) { set(true, broken); }
  void shut() { set(false, false); }

 private:
  void set(bool open, bool broken) {
    const std::scoped_lock lock(mutex_);
    open_ = open;
    broken_ = broken;
    changed_.notify_all();
  }

  mutable std::mutex mutex_;
  mutable std::condition_variable changed_;
  bool open_ = false, broken_ = false;
};

// Counts what the localizer's thread says, so that the test can wait for the next of it.
class FrameProgress {
 public:
  void notify(int& counted) {
    const std::scoped_lock lock(mutex_);
    ++counted;
    changed_.notify_all();
  }
  void wait(const int& counted, int wanted) {
    std::unique_lock lock(mutex_);
    ASSERT_TRUE(changed_.wait_for(lock, kReplayLimit, [&] { return counted >= wanted; }));
  }
  int frames = 0, looks = 0, hints = 0;

 private:
  std::mutex mutex_;
  std::condition_variable changed_;
};

class LocalizationReplay : public ::testing::Test {
 protected:
  // A start that claims 5 m and is 190 m off: without the hint the localizer stays there.
  LocalizationReplay() : LocalizationReplay(flight_camera(), place_of({70, 90}), 5) {}
  LocalizationReplay(const CameraFile& camera, LonLat start, double start_sigma_m)
      : camera_(camera),
        start_(start),
        start_sigma_m_(start_sigma_m),
        recorder_(recorder_options(), session(), [] { return std::uint64_t{1}; }) {}

  LocalizationSetup setup(const TileSource& tiles) const {
    LocalizerConfig chosen = config();
    chosen.area = PlaneBox{-130, -130, 130, 130};
    chosen.start_sigma_m = start_sigma_m_;
    return {camera_, {}, LocalFrame(kOrigin), &tiles, start_, chosen, 0};
  }

  RecorderOptions recorder_options() const {
    RecorderOptions options;
    options.store.folder = folder_ / "recording";
    options.store.sync = false;
    options.when_full = WhenFull::wait;
    options.keep_pictures = true;
    return options;
  }

  SessionRecord session() const {
    const LocalizationSetup flown = setup(landscape_tiles());
    SessionRecord session;
    session.id = "test";
    session.camera = flown.camera;
    session.origin = kOrigin;
    session.start = flown.start;
    session.localizer = flown.config;
    session.places = false;
    session.looked_up_later = true;
    return session;
  }

  LocalizationThread::Listener listener() {
    return {[this](std::uint64_t index, const Telemetry& telemetry, ByteView encoded) {
              record_input(recorder_, index, telemetry, encoded);
            },
            [this](const LocalizedFrame& frame) {
              if (frame.late) {
                record_anchor(recorder_, frame.anchor_index, frame.index, frame.report);
                last_verdict_ = frame.report.anchor.verdict;
              } else {
                record_frame(recorder_, frame.index, frame.report);
                last_source_ = frame.report.estimate.source;
                if (frame.report.anchor.verdict == AnchorVerdict::frame_unfit) ++unfit_;
              }
              progress_.notify(frame.late ? progress_.looks : progress_.frames);
            },
            [this](const HintRecord& hint) {
              recorder_.record(hint);
              progress_.notify(progress_.hints);
            }};
  }

  // One picture, followed before this returns.
  void fly(LocalizationThread& localization, const Moment& moment) {
    const Telemetry& telemetry = moment.telemetry;
    localization.on_message(telemetry.time_s,
                            AircraftAttitude{0, *telemetry.roll_rad, *telemetry.pitch_rad, *telemetry.heading_rad, {}});
    localization.on_message(telemetry.time_s, GroundHeight{{}, 0, *telemetry.agl_m});
    frames_.put({telemetry.frame, encode_image(moment.image, ImageFormat::png), telemetry.time_s});
    progress_.wait(progress_.frames, ++flown_);
  }

  RecordedFlight recorded() {
    recorder_.close("test");
    std::filesystem::create_directories(folder_ / "unpacked");
    return read_recorded_flight({folder_ / "recording", std::nullopt, std::nullopt, folder_ / "unpacked"});
  }

  Reproduction replay(const RecordedFlight& flight) {
    ReplaySetup again{.frame = LocalFrame(flight.session.origin),
                      .tiles = &landscape_tiles(),
                      .start = flight.session.start,
                      .area = std::nullopt,
                      .recorded = &flight};
    EstimatesCsv csv(folder_ / "estimates.csv");
    NoProgress progress;
    const auto flown = replay_flight(flight.flight, again, Truth(flight.flight.frames.size()), &csv, progress);
    return compare_estimates(flight.estimates, flown.published);
  }

  const CameraFile camera_;
  const LonLat start_;
  const double start_sigma_m_;
  const TemporaryFolder folder_;
  const SystemFlightClock clock_;
  ThreadWatch watch_{clock_};
  LatestMailbox<CapturedFrame> frames_;
  FrameProgress progress_;
  int flown_ = 0;
  AnchorVerdict last_verdict_ = AnchorVerdict::not_tried;
  SourceLabel last_source_ = SourceLabel::no_fix;
  int unfit_ = 0;
  Recorder recorder_;
};

TEST_F(LocalizationReplay, HintsAndLateAnchorsReplayBitForBit) {
  const std::vector<Moment> moments = flight(7);
  {
    GatedTiles tiles;
    LocalizationThread localization(setup(tiles), frames_, watch_, listener());
    fly(localization, moments[0]);  // its look at the map lasts
    localization.hint(place_of({1e9, 1e9}), -1, "nobody");
    const PlanePoint there = moments[1].truth.position;
    localization.hint(place_of({there.east_m + 30, there.north_m}), 60, "operator");
    progress_.wait(progress_.hints, 1);
    fly(localization, moments[1]);
    tiles.open();
    progress_.wait(progress_.looks, 1);
    EXPECT_NE(last_verdict_, AnchorVerdict::accepted) << "the start is wrong, and the hint has only made it doubtful";
    tiles.shut();
    fly(localization, moments[2]);  // the hint is heeded
    fly(localization, moments[3]);
    tiles.open();
    progress_.wait(progress_.looks, 2);
    EXPECT_EQ(last_verdict_, AnchorVerdict::accepted);
    for (std::size_t i = 4; i < 7; ++i) {
      fly(localization, moments[i]);
      if (i < 6) progress_.wait(progress_.looks, static_cast<int>(i) - 1);
    }
  }
  RecordedFlight flight = recorded();
  const auto hint = std::ranges::find_if(flight.between, [](const BetweenFrames& one) { return one.index() == 1; });
  ASSERT_NE(hint, flight.between.end());
  EXPECT_EQ(std::get<HintRecord>(*hint).before, 1U);
  EXPECT_EQ(std::get<HintRecord>(*hint).by, "operator");

  const Reproduction same = replay(flight);
  EXPECT_GE(same.compared, 11U) << "seven frames, and four looks at the map";
  EXPECT_EQ(same.same, same.compared) << same.first_other.value_or("");

  flight.between.erase(hint);
  flight.flight.frames.resize(3);
  flight.flight.files.resize(3);
  const Reproduction other = replay(flight);
  EXPECT_EQ(other.first_other, moments[1].telemetry.frame) << "or the hint was of no account";
}

// A camera with a rolling shutter on a gimbal, under an aircraft that flies another heading and banks.
class GimbalReplay : public LocalizationReplay {
 protected:
  GimbalReplay() : LocalizationReplay(camera(), start(), 20) {}

  static CameraFile camera() {
    CameraFile file = flight_camera();
    file.on_gimbal = true;
    file.readout = SensorReadout{0.02};
    return file;
  }
  // The axes of a gimbal that carries this camera: ahead, right, down; from the aircraft's heading, or from north.
  static GimbalAttitude gimbal(const Attitude& camera, std::optional<double> heading_rad) {
    const Eigen::Matrix3d axes = enu_from_camera(camera);
    const auto ned = [](const Eigen::Vector3d& enu) { return Eigen::Vector3d(enu.y(), enu.x(), -enu.z()); };
    Eigen::Matrix3d ned_from_gimbal;
    ned_from_gimbal << ned(axes.col(2)), ned(axes.col(0)), ned(axes.col(1));
    const Eigen::Quaterniond q(Eigen::AngleAxisd(-heading_rad.value_or(0), Eigen::Vector3d::UnitZ()) * ned_from_gimbal);
    return {0, 0, {q.w(), q.x(), q.y(), q.z()}, !heading_rad, false};
  }
};

TEST_F(GimbalReplay, FramesWithoutItsAttitudeAreNotUsedAndTheFlightReplaysBitForBit) {
  const std::vector<Moment> moments = flight(6);
  const double heading_rad = radians(-100);
  {
    GatedTiles tiles;
    tiles.open();
    LocalizationThread localization(setup(tiles), frames_, watch_, listener());
    double time_s = moments[0].telemetry.time_s - 0.1;
    int looks = 0;
    for (std::size_t i = 0; i < moments.size(); ++i) {
      const Moment& moment = moments[i];
      for (; time_s < moment.telemetry.time_s + 0.05; time_s += 0.1) {
        localization.on_message(time_s, AircraftAttitude{0, radians(35), 0, heading_rad, {}});
        localization.on_message(
            time_s, ImuSample{1, 0, {0, -9.80665 * std::sin(radians(35)), -9.80665 * std::cos(radians(35))}, {}});
      }
      const bool known = i != 3;
      const auto relative = i % 2 == 0 ? std::optional(heading_rad) : std::nullopt;
      for (const double off_s : {-0.02, 0.02}) {
        if (known) localization.on_message(moment.telemetry.time_s + off_s, gimbal(moment.truth.attitude, relative));
      }
      localization.on_message(moment.telemetry.time_s, GroundHeight{{}, 0, *moment.telemetry.agl_m});
      frames_.put({moment.telemetry.frame, encode_image(moment.image, ImageFormat::png), moment.telemetry.time_s});
      progress_.wait(progress_.frames, ++flown_);
      if (!known) {
        EXPECT_EQ(unfit_, 1);
        EXPECT_EQ(last_source_, SourceLabel::dead_reckoned);
        continue;
      }
      progress_.wait(progress_.looks, ++looks);
      EXPECT_EQ(last_verdict_, AnchorVerdict::accepted) << i;
    }
    EXPECT_EQ(unfit_, 1) << "and no other";
  }
  const RecordedFlight flight = recorded();
  EXPECT_TRUE(flight.session.camera.on_gimbal);
  EXPECT_TRUE(flight.flight.frames[1].rate_rad_s);
  EXPECT_FALSE(flight.flight.frames[3].pitch_rad);
  for (const std::size_t i : {0U, 1U, 2U, 4U, 5U}) {
    const Telemetry& telemetry = flight.flight.frames[i];
    ASSERT_TRUE(telemetry.heading_rad) << i;
    EXPECT_NEAR(wrap_pi(*telemetry.heading_rad - moments[i].truth.attitude.heading_rad), 0, 1e-6) << i;
    EXPECT_NEAR(*telemetry.roll_rad, moments[i].truth.attitude.roll_rad, 1e-6);
  }
  const Reproduction same = replay(flight);
  EXPECT_GE(same.compared, 11U) << "six frames, and five looks at the map";
  EXPECT_EQ(same.same, same.compared) << same.first_other.value_or("");
}

// Half a minute without pictures: what the autopilot telemetry meanwhile is part of what came with the next one.
TEST_F(LocalizationReplay, APathWithoutFramesReplaysBitForBit) {
  std::vector<Moment> moments = flight(3);
  constexpr double kGap_s = 33;
  const Telemetry before = moments[1].telemetry;
  {
    GatedTiles tiles;
    tiles.open();
    LocalizationThread localization(setup(tiles), frames_, watch_, listener());
    for (int looks = 0; const Moment* moment : {&moments[0], &moments[1]}) {
      fly(localization, *moment);
      progress_.wait(progress_.looks, ++looks);
    }
    for (double s = 0.1; s < kGap_s; s += 0.1) {
      const double turned = 2 * std::sin(s / kGap_s * kPi);
      localization.on_message(before.time_s + s, AircraftAttitude{0, 0, 0, *before.heading_rad + turned, {}});
      localization.on_message(before.time_s + s, ImuSample{1, 0, {0.1, 0, -9.8}, {}});
    }
    moments[2].telemetry.time_s = before.time_s + kGap_s;
    fly(localization, moments[2]);
  }
  const RecordedFlight flight = recorded();
  const Telemetry& after = flight.flight.frames[2];
  EXPECT_EQ(after.intervals.size(), kGap_s / kMaxTelemetryInterval_s - 1);
  EXPECT_TRUE(after.intervals.front().heading_rad && after.intervals.front().imu_dv_mps);
  const Reproduction same = replay(flight);
  EXPECT_GE(same.compared, 5U);
  EXPECT_EQ(same.same, same.compared) << same.first_other.value_or("");
}

// No height above the terrain means that it stands there where somebody said that it is; elsewhere it may be another
// hill.
TEST_F(LocalizationReplay, WithAHintAndNoHeightTheAircraftIsOnTheGround) {
  const std::vector<Moment> moments = flight(3);
  const FlatGround ground;
  {
    GatedTiles tiles;
    tiles.open();
    LocalizationSetup nowhere = setup(tiles);
    nowhere.start.reset();
    nowhere.config.surface = &ground;
    LocalizationThread localization(nowhere, frames_, watch_, listener());
    const auto show = [&](const Moment& moment, double msl_m) {
      const Telemetry& telemetry = moment.telemetry;
      localization.on_message(telemetry.time_s, AircraftAttitude{0, 0, 0, *telemetry.heading_rad, {}});
      localization.on_message(telemetry.time_s, GlobalPosition{0, kOrigin, msl_m, 0, {}, {}});
      frames_.put({telemetry.frame, encode_image(moment.image, ImageFormat::png), telemetry.time_s});
      progress_.wait(progress_.frames, ++flown_);
    };
    show(moments[0], -2);
    localization.hint(kOrigin, 150, "GPS");
    progress_.wait(progress_.hints, 1);
    show(moments[1], -2);
    show(moments[2], -20);
  }
  const std::vector<Telemetry> frames = recorded().flight.frames;
  ASSERT_EQ(frames.size(), 3U);
  EXPECT_FALSE(frames[0].agl_m);
  EXPECT_EQ(frames[1].agl_m, 1.0);
  EXPECT_FALSE(frames[2].agl_m) << "far under the ground stands nobody";
}

// After a start in flight, before any telemetry: with every heading possible the first search would take long.
TEST_F(LocalizationReplay, AFrameBeforeTheFirstAttitudeIsSkipped) {
  std::vector<Moment> moments = flight(4);
  {
    GatedTiles tiles;
    tiles.open();
    LocalizationThread localization(setup(tiles), frames_, watch_, listener());
    const auto show = [&](const Moment& moment) {
      frames_.put({moment.telemetry.frame, encode_image(moment.image, ImageFormat::png), moment.telemetry.time_s});
      while (frames_.counts().taken < frames_.counts().put) std::this_thread::yield();
    };
    show(moments[0]);
    fly(localization, moments[1]);
    progress_.wait(progress_.looks, 1);
  }
  const RecordedFlight flight = recorded();
  ASSERT_EQ(flight.flight.frames.size(), 1);
  EXPECT_EQ(flight.flight.frames[0].frame, moments[1].telemetry.frame);
  EXPECT_EQ(replay(flight).same, 2U);
}

// Frames are matched even if the autopilot never sends anything.
TEST_F(LocalizationReplay, WithoutAnyAttitudeFramesAreProcessedAfterAWhile) {
  std::vector<Moment> moments = flight(2);
  GatedTiles tiles;
  tiles.open();
  LocalizationThread localization(setup(tiles), frames_, watch_, listener());
  double seconds = 0;
  for (const Moment& moment : moments) {
    frames_.put({moment.telemetry.frame, encode_image(moment.image, ImageFormat::png), 100 + seconds});
    while (frames_.counts().taken < frames_.counts().put) std::this_thread::yield();
    seconds += 10;
  }
  progress_.wait(progress_.frames, 1);
}

TEST_F(LocalizationReplay, AFailedMatchHasNoResult) {
  const std::vector<Moment> moments = flight(3);
  {
    GatedTiles tiles;
    LocalizationSetup sound = setup(tiles);
    LocalizationThread localization(sound, frames_, watch_, listener());
    fly(localization, moments[0]);
    tiles.open(true);
    progress_.wait(progress_.looks, 1);
    EXPECT_EQ(last_verdict_, AnchorVerdict::not_tried);
    tiles.open();
    fly(localization, moments[1]);
    progress_.wait(progress_.looks, 2);
    fly(localization, moments[2]);
  }
  const RecordedFlight flight = recorded();
  ASSERT_FALSE(flight.between.empty());
  EXPECT_FALSE(std::get<LateAnchor>(flight.between.front()).looked);
  const Reproduction same = replay(flight);
  EXPECT_GE(same.compared, 5U);
  EXPECT_EQ(same.same, same.compared) << same.first_other.value_or("");
}

}  // namespace
}  // namespace nadir
