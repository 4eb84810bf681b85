// A stop, or a hint, in the middle of a search over all of a wide area: counted is what is still looked at, not how
// long it takes.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <chrono>
#include <condition_variable>
#include <functional>
#include <mutex>
#include <stdexcept>
#include <vector>

#include "estimation/localizer_fixture.hpp"
#include "flight/localization_thread.hpp"
#include "geodesy/web_mercator.hpp"
#include "imagery/codecs.hpp"

namespace nadir {
namespace {

using namespace test;

constexpr PlaneBox kWide{-3200, -3200, 3200, 3200};  // sixteen windows
constexpr std::chrono::seconds kSearchLimit{120};    // only so that what hangs fails

// A map without an end, every tile of it the same. Whoever reads waits until the gate is open.
class EndlessTiles final : public TileSource {
 public:
  ZoomRange zooms() const override { return landscape_tiles().zooms(); }
  std::optional<Bytes> read(const TileKey&) const override {
    std::unique_lock lock(mutex_);
    ++reads_;
    changed_.notify_all();
    changed_.wait_for(lock, kSearchLimit, [&] { return open_; });
    return landscape_tiles().read(tile_at(kOrigin, zooms().max));
  }

  bool await_reader() const {
    std::unique_lock lock(mutex_);
    return changed_.wait_for(lock, kSearchLimit, [&] { return reads_ > 0; });
  }
  void open() {
    const std::scoped_lock lock(mutex_);
    open_ = true;
    changed_.notify_all();
  }
  int reads() const {
    const std::scoped_lock lock(mutex_);
    return reads_;
  }

 private:
  mutable std::mutex mutex_;
  mutable std::condition_variable changed_;
  mutable int reads_ = 0;
  bool open_ = false;
};

// A search of all the area for one picture, held in the middle of its first window.
class LongSearch : public ::testing::Test {
 protected:
  static LocalizationSetup setup(const TileSource& tiles) {
    LocalizerConfig lost = config();
    lost.area = kWide;
    return {flight_camera(), {}, LocalFrame(kOrigin), &tiles, std::nullopt, lost, 0};
  }

  LocalizationThread::Listener listener() {
    return {[](std::uint64_t, const Telemetry&, ByteView) {},
            [this](const LocalizedFrame& frame) {
              const std::scoped_lock lock(mutex_);
              if (frame.late) looks_.push_back(frame.report.anchor.verdict);
              changed_.notify_all();
            },
            [this](const HintRecord&) {
              const std::scoped_lock lock(mutex_);
              ++hints_;
              changed_.notify_all();
            }};
  }

  void search(LocalizationThread& localization) {
    const Moment& moment = short_flight()[0];
    const Telemetry& telemetry = moment.telemetry;
    localization.on_message(telemetry.time_s,
                            AircraftAttitude{0, *telemetry.roll_rad, *telemetry.pitch_rad, *telemetry.heading_rad, {}});
    localization.on_message(telemetry.time_s, GroundHeight{{}, 0, *telemetry.agl_m});
    frames_.put({telemetry.frame, encode_image(moment.image, ImageFormat::png), telemetry.time_s});
    ASSERT_TRUE(tiles_.await_reader());
  }

  void await(const std::function<bool()>& done) {
    std::unique_lock lock(mutex_);
    ASSERT_TRUE(changed_.wait_for(lock, kSearchLimit, done));
  }

  void expect_one_window() const {
    const double tile_m = kTileSize * ground_resolution_m(tiles_.zooms().max, kOrigin.lat_deg);
    const double tiles_of_area = (kWide.east_m - kWide.west_m) * (kWide.north_m - kWide.south_m) / (tile_m * tile_m);
    EXPECT_LT(tiles_.reads(), tiles_of_area / 8) << "one window of sixteen, with its margin";
  }

  const SystemFlightClock clock_;
  ThreadWatch watch_{clock_};
  LatestMailbox<CapturedFrame> frames_;
  EndlessTiles tiles_;
  std::mutex mutex_;
  std::condition_variable changed_;
  std::vector<AnchorVerdict> looks_;
  int hints_ = 0;
};

TEST_F(LongSearch, AStopCancelsItWithinTheWindowAndReportsNothing) {
  {
    LocalizationThread localization(setup(tiles_), frames_, watch_, listener());
    search(localization);
    localization.request_stop();
    tiles_.open();
  }
  expect_one_window();
  EXPECT_TRUE(looks_.empty()) << "a cancelled search reports no result";
}

// Somebody says where to look, in the middle of a search that began when nobody did.
TEST_F(LongSearch, AHintCancelsIt) {
  {
    LocalizationThread localization(setup(tiles_), frames_, watch_, listener());
    search(localization);
    localization.hint(kOrigin, 100, "operator");
    await([&] { return hints_ == 1; });
    tiles_.open();
    await([&] { return looks_.size() == 1; });
  }
  expect_one_window();
  EXPECT_EQ(looks_.front(), AnchorVerdict::not_tried) << "given up is not \"not found\"";
}

// A picture of another size, or damaged, costs the thread nothing but a look at its header; it counts as dropped.
TEST(LocalizationFrames, WhatCannotBeDecodedIsDroppedAndCounted) {
  const SystemFlightClock clock;
  ThreadWatch watch(clock);
  LatestMailbox<CapturedFrame> frames;
  std::mutex mutex;
  std::condition_variable changed;
  int processed = 0;
  LocalizationThread localization({flight_camera(), {}, LocalFrame(kOrigin), nullptr, start(), config(), 0}, frames,
                                  watch,
                                  {[](std::uint64_t, const Telemetry&, ByteView) {},
                                   [&](const LocalizedFrame&) {
                                     const std::scoped_lock lock(mutex);
                                     ++processed;
                                     changed.notify_all();
                                   },
                                   [](const HintRecord&) {}});
  const Moment& moment = short_flight()[0];
  const Telemetry& telemetry = moment.telemetry;
  localization.on_message(telemetry.time_s,
                          AircraftAttitude{0, *telemetry.roll_rad, *telemetry.pitch_rad, *telemetry.heading_rad, {}});
  localization.on_message(telemetry.time_s, GroundHeight{{}, 0, *telemetry.agl_m});
  const auto give = [&](const Bytes& encoded, double after_s) {
    std::unique_lock lock(mutex);
    const int before = processed;
    frames.put({"frame", encoded, telemetry.time_s + after_s});
    return changed.wait_for(lock, kSearchLimit, [&] { return processed > before; });
  };
  const Bytes good = encode_image(moment.image, ImageFormat::png);
  const cv::Mat small(moment.image.rows / 2, moment.image.cols / 2, CV_8UC1, cv::Scalar(90));
  ASSERT_TRUE(give(good, 0));
  EXPECT_EQ(localization.undecodable(), 0U);
  ASSERT_TRUE(give(encode_image(small, ImageFormat::png), 0.3));
  EXPECT_EQ(localization.undecodable(), 1U);
  ASSERT_TRUE(give(Bytes(good.begin(), good.begin() + 100), 0.6));
  EXPECT_EQ(localization.undecodable(), 2U);
  ASSERT_TRUE(give(good, 0.9));
  EXPECT_EQ(localization.undecodable(), 2U);
}

// Tiles whose reading throws, for whatever reason: no memory, an error in OpenCV.
class ThrowingTiles final : public TileSource {
 public:
  ZoomRange zooms() const override { return landscape_tiles().zooms(); }
  std::optional<Bytes> read(const TileKey&) const override { throw std::runtime_error("insufficient memory"); }
};

TEST_F(LongSearch, AMatchThatThrowsIsReportedEachTimeAndComesBackWithoutAResult) {
  const ThrowingTiles tiles;
  std::vector<std::string> failures;
  LocalizationThread::Listener listening = listener();
  listening.on_match_failed = [&](const std::string& reason) {
    const std::scoped_lock lock(mutex_);
    failures.push_back(reason);
  };
  {
    LocalizationThread localization(setup(tiles), frames_, watch_, std::move(listening));
    const Moment& moment = short_flight()[0];
    const Telemetry& telemetry = moment.telemetry;
    localization.on_message(telemetry.time_s,
                            AircraftAttitude{0, *telemetry.roll_rad, *telemetry.pitch_rad, *telemetry.heading_rad, {}});
    localization.on_message(telemetry.time_s, GroundHeight{{}, 0, *telemetry.agl_m});
    frames_.put({telemetry.frame, encode_image(moment.image, ImageFormat::png), telemetry.time_s});
    await([&] { return looks_.size() == 1; });
  }
  ASSERT_EQ(failures.size(), 1U);
  EXPECT_THAT(failures.front(), testing::HasSubstr("insufficient memory"));
  EXPECT_EQ(looks_.front(), AnchorVerdict::not_tried);
}

TEST_F(LongSearch, ACancelledSearchDidNotFail) {
  int failures = 0;
  LocalizationThread::Listener listening = listener();
  listening.on_match_failed = [&](const std::string&) { ++failures; };
  {
    LocalizationThread localization(setup(tiles_), frames_, watch_, std::move(listening));
    search(localization);
    localization.hint(kOrigin, 100, "operator");
    await([&] { return hints_ == 1; });
    tiles_.open();
    await([&] { return looks_.size() == 1; });
  }
  EXPECT_EQ(failures, 0);
}

}  // namespace
}  // namespace nadir
