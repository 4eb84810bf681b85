// Pictures and troubles of a camera on their way to the localizer. The camera of the test gives what it was told to
// give, then nothing more.
#include "flight/camera_feed.hpp"

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <condition_variable>
#include <deque>

#include "imagery/codecs.hpp"
#include "support/manual_clock.hpp"

namespace nadir {
namespace {

constexpr std::chrono::seconds kFarTooLong{120};  // only so that what hangs fails

class ScriptedCamera final : public CameraSource {
 public:
  explicit ScriptedCamera(std::deque<CameraReading> script) : script_(std::move(script)) {}

  CameraReading next(std::chrono::milliseconds at_most, std::stop_token stop) override {
    if (script_.empty()) {
      std::mutex mutex;
      std::unique_lock lock(mutex);
      std::condition_variable_any().wait_for(lock, std::move(stop), at_most, [] { return false; });
      return {};
    }
    CameraReading reading = std::move(script_.front());
    script_.pop_front();
    return reading;
  }
  std::string describe() const override { return "a script"; }

 private:
  std::deque<CameraReading> script_;
};

CameraReading picture(const std::string& name, double time_s, Bytes bytes) {
  return {CameraStatus::frame, {name, time_s, std::move(bytes), std::nullopt}, {}};
}
CameraReading trouble(const std::string& text) { return {CameraStatus::trouble, {}, text}; }

class CameraFeedTest : public ::testing::Test {
 protected:
  // Feeds the script, until `told` has been called so many times.
  void feed(std::deque<CameraReading> script, std::size_t calls) {
    CameraFeed feed(std::make_unique<ScriptedCamera>(std::move(script)), 0.25, clock_, pictures_, watch_,
                    [this](const std::string& text) {
                      const std::scoped_lock lock(mutex_);
                      told_.push_back(text);
                      changed_.notify_all();
                    });
    EXPECT_EQ(feed.describe(), "a script");
    std::unique_lock lock(mutex_);
    EXPECT_TRUE(changed_.wait_for(lock, kFarTooLong, [&] { return told_.size() >= calls; }));
    left_out_ = feed.left_out();
  }

  const SystemFlightClock clock_;
  ThreadWatch watch_{clock_};
  LatestMailbox<CapturedFrame> pictures_{8};
  std::mutex mutex_;
  std::condition_variable changed_;
  std::vector<std::string> told_;
  std::uint64_t left_out_ = 0;
};

TEST_F(CameraFeedTest, APictureCountsFromItsExposureAndItsBytesStayAsTheyAre) {
  feed({picture("1.jpg", 12, {1, 2, 3}), picture("2.jpg", 13, {4}), trouble("the end")}, 3);
  const auto first = pictures_.try_take(), second = pictures_.try_take();
  ASSERT_TRUE(first && second);
  EXPECT_EQ(first->name, "1.jpg");
  EXPECT_EQ(first->encoded, (Bytes{1, 2, 3}));
  EXPECT_EQ(first->taken_s, 11.75);
  EXPECT_EQ(second->name, "2.jpg");
  EXPECT_EQ(told_, (std::vector<std::string>{"", "", "the end"}));
}

TEST_F(CameraFeedTest, PixelsAreEncodedWithoutLoss) {
  const Bytes grey{0, 50, 100, 150, 200, 255}, colour{9, 8, 7, 6, 5, 4, 3, 2, 1, 0, 255, 128};
  CameraReading one = picture("1", 1, grey), two = picture("2", 2, colour);
  one.frame.raw = RawPixels{3, 2, 1};
  two.frame.raw = RawPixels{2, 2, 3};
  feed({one, two, trouble("the end")}, 3);
  const auto first = pictures_.try_take(), second = pictures_.try_take();
  ASSERT_TRUE(first && second);
  const cv::Mat read = decode_image(first->encoded, Colour::grey, "test").image;
  ASSERT_EQ(read.size(), cv::Size(3, 2));
  EXPECT_TRUE(std::equal(grey.begin(), grey.end(), read.datastart));
  EXPECT_EQ(read_image_info(second->encoded, "test").width, 2);
  EXPECT_EQ(read_image_info(second->encoded, "test").format, ImageFormat::png);
}

TEST_F(CameraFeedTest, TroubleIsToldOnceUntilItIsOverOrAnother) {
  feed({trouble("unplugged"), trouble("unplugged"), trouble("no room"), picture("1", 1, {1}), trouble("no room")}, 4);
  EXPECT_EQ(told_, (std::vector<std::string>{"unplugged", "no room", "", "no room"}));
  EXPECT_EQ(pictures_.counts().put, 1U);
}

// Ten seconds of pictures at once are ten seconds old, but for the one that comes in its time again.
TEST_F(CameraFeedTest, WhatTheCameraHeldBackIsLeftOut) {
  std::deque<CameraReading> script;
  for (const double at_s : {1.0, 2.0, 3.0, 4.0}) script.push_back(picture(fmt::format("{:.0f}", at_s), at_s, {1}));
  for (const char* name : {"5", "6", "7"}) script.push_back(picture(name, 14, {1}));
  script.push_back(picture("15", 15, {1}));
  script.push_back(picture("25", 25, {1}));  // a pause, and nothing held back
  script.push_back(picture("26", 26, {1}));
  feed(script, 8);
  std::string handed_on;
  while (const auto one = pictures_.try_take()) handed_on += one->name + ' ';
  EXPECT_EQ(handed_on, "1 2 3 4 15 25 26 ");
  EXPECT_EQ(left_out_, 3U) << "counted all the same";
  EXPECT_EQ(std::count(told_.begin(), told_.end(), ""), 7);
  EXPECT_EQ(told_[4], "the camera hands out pictures that it had held back; they are left out");
}

TEST_F(CameraFeedTest, ThePictureAfterAPauseIsHandedOnWhenNoneComesUponIt) {
  ManualClock clock(14.5);
  std::deque<CameraReading> script;
  for (const double at_s : {1.0, 2.0, 3.0, 4.0, 14.0})
    script.push_back(picture(fmt::format("{:.0f}", at_s), at_s, {1}));
  CameraFeed feed(std::make_unique<ScriptedCamera>(std::move(script)), 0, clock, pictures_, watch_,
                  [](const std::string&) {});
  for (const char* name : {"1", "2", "3", "4"}) {
    const auto one = pictures_.take_within(kFarTooLong, {});
    ASSERT_TRUE(one);
    EXPECT_EQ(one->name, name);
  }
  clock.advance(0.5);
  const auto last = pictures_.take_within(kFarTooLong, {});
  ASSERT_TRUE(last);
  EXPECT_EQ(last->name, "14");
  EXPECT_EQ(last->taken_s, 14) << "it counts from when it came";
}

// The clock stands still: only the wish to stop can end the pause after a trouble.
TEST_F(CameraFeedTest, StopsAtOnceAfterTrouble) {
  const ManualClock clock;
  std::condition_variable told;
  bool in_trouble = false;
  CameraFeed feed(std::make_unique<ScriptedCamera>(std::deque{trouble("unplugged")}), 0, clock, pictures_, watch_,
                  [&](const std::string&) {
                    const std::scoped_lock lock(mutex_);
                    in_trouble = true;
                    told.notify_all();
                  });
  std::unique_lock lock(mutex_);
  ASSERT_TRUE(told.wait_for(lock, kFarTooLong, [&] { return in_trouble; }));
}

}  // namespace
}  // namespace nadir
