// Frames and failures of a camera on their way to the localizer. The camera of the test follows a script, then times
// out.
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

constexpr std::chrono::seconds kFarTooLong{120};  // a hanging test fails

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

CameraReading image(const std::string& name, double time_s, Bytes bytes) {
  return {CameraStatus::frame, {name, time_s, std::move(bytes), std::nullopt}, {}};
}
CameraReading failure(const std::string& text) { return {CameraStatus::failure, {}, text}; }

class CameraFeedTest : public ::testing::Test {
 protected:
  // Feeds the script, until so many events were reported.
  void feed(std::deque<CameraReading> script, std::size_t calls) { feed(std::move(script), calls, clock_); }
  void feed(std::deque<CameraReading> script, std::size_t calls, const FlightClock& clock) {
    CameraFeed feed(std::make_unique<ScriptedCamera>(std::move(script)), 0.25, clock, frames_, watch_,
                    [this](const OnboardEvent& event) {
                      const auto* failed = std::get_if<CameraFailed>(&event);
                      ASSERT_TRUE(failed != nullptr || std::holds_alternative<FrameReceived>(event));
                      const std::scoped_lock lock(mutex_);
                      reported_.push_back(failed != nullptr ? failed->reason : "");
                      changed_.notify_all();
                    });
    EXPECT_EQ(feed.describe(), "a script");
    std::unique_lock lock(mutex_);
    EXPECT_TRUE(changed_.wait_for(lock, kFarTooLong, [&] { return reported_.size() >= calls; }));
    stale_ = feed.stale();
  }

  const SystemFlightClock clock_;
  ThreadWatch watch_{clock_};
  LatestMailbox<CapturedFrame> frames_{8};
  std::mutex mutex_;
  std::condition_variable changed_;
  std::vector<std::string> reported_;
  std::uint64_t stale_ = 0;
};

// Somebody fills the camera's folder with broken files: they are one event, and the next frame waits for none of them.
TEST_F(CameraFeedTest, AFloodOfBadFramesDelaysNothing) {
  std::deque<CameraReading> script;
  for (int i = 0; i < 300; ++i)
    script.push_back({CameraStatus::bad_frame, {}, std::to_string(i) + ".jpg is truncated"});
  script.push_back(image("good.jpg", 12, {1}));
  feed(std::move(script), 2, ManualClock());  // all within one second
  EXPECT_EQ(reported_, (std::vector<std::string>{"0.jpg is truncated", ""}));
  EXPECT_EQ(frames_.try_take()->name, "good.jpg");
}

TEST_F(CameraFeedTest, CaptureTimeAllowsForTheDelayAndBytesAreUnchanged) {
  feed({image("1.jpg", 12, {1, 2, 3}), image("2.jpg", 13, {4}), failure("the end")}, 3);
  const auto first = frames_.try_take(), second = frames_.try_take();
  ASSERT_TRUE(first && second);
  EXPECT_EQ(first->name, "1.jpg");
  EXPECT_EQ(first->encoded, (Bytes{1, 2, 3}));
  EXPECT_EQ(first->captured_s, 11.75);
  EXPECT_EQ(second->name, "2.jpg");
  EXPECT_EQ(reported_, (std::vector<std::string>{"", "", "the end"}));
}

// A camera that stamps its frames: the delay is what its stamp does not know.
TEST_F(CameraFeedTest, AStampCountsAndFramesThatSayTheyAreOldAreDropped) {
  CameraReading stamped = image("1.jpg", 12, {1}), old = image("2.jpg", 13, {2}), fresh = image("3.jpg", 14, {3});
  stamped.frame.age_s = 0.5;
  old.frame.age_s = 2.5;
  fresh.frame.age_s = 0;
  feed({stamped, old, fresh, failure("the end")}, 4);
  const auto first = frames_.try_take(), second = frames_.try_take();
  ASSERT_TRUE(first && second);
  EXPECT_EQ(first->captured_s, 11.25);
  EXPECT_EQ(second->name, "3.jpg");
  EXPECT_EQ(second->captured_s, 13.75);
  EXPECT_EQ(stale_, 1U);
}

TEST_F(CameraFeedTest, PixelsAreEncodedLosslessly) {
  const Bytes grey{0, 50, 100, 150, 200, 255}, colour{9, 8, 7, 6, 5, 4, 3, 2, 1, 0, 255, 128};
  CameraReading one = image("1", 1, grey), two = image("2", 2, colour);
  one.frame.raw = RawPixels{3, 2, 1};
  two.frame.raw = RawPixels{2, 2, 3};
  feed({one, two, failure("the end")}, 3);
  const auto first = frames_.try_take(), second = frames_.try_take();
  ASSERT_TRUE(first && second);
  const cv::Mat read = decode_image(first->encoded, Colour::grey, "test").image;
  ASSERT_EQ(read.size(), cv::Size(3, 2));
  EXPECT_TRUE(std::equal(grey.begin(), grey.end(), read.datastart));
  EXPECT_EQ(read_image_info(second->encoded, "test").width, 2);
  EXPECT_EQ(read_image_info(second->encoded, "test").format, ImageFormat::png);
}

TEST_F(CameraFeedTest, AFailureIsReportedOnceUntilItEndsOrChanges) {
  feed({failure("unplugged"), failure("unplugged"), failure("no room"), image("1", 1, {1}), failure("no room")}, 4);
  EXPECT_EQ(reported_, (std::vector<std::string>{"unplugged", "no room", "", "no room"}));
  EXPECT_EQ(frames_.counts().put, 1U);
}

// Ten seconds of pictures at once are ten seconds old, but for the one that comes in its time again.
TEST_F(CameraFeedTest, StaleFramesAreDropped) {
  std::deque<CameraReading> script;
  for (const double at_s : {1.0, 2.0, 3.0, 4.0}) script.push_back(image(fmt::format("{:.0f}", at_s), at_s, {1}));
  for (const char* name : {"5", "6", "7"}) script.push_back(image(name, 14, {1}));
  script.push_back(image("15", 15, {1}));
  script.push_back(image("25", 25, {1}));  // after another pause: nobody knows when it was captured
  script.push_back(image("26", 26, {1}));
  feed(script, 7);
  std::string delivered;
  while (const auto one = frames_.try_take()) delivered += one->name + ' ';
  EXPECT_EQ(delivered, "1 2 3 4 15 26 ");
  EXPECT_EQ(stale_, 4U) << "counted all the same";
  EXPECT_EQ(std::count(reported_.begin(), reported_.end(), ""), 6);
  EXPECT_EQ(reported_[4], "the camera delivers stale frames from its buffer; they are dropped");
}

TEST_F(CameraFeedTest, FramesThatSayHowOldTheyAreNeedNoProof) {
  std::deque<CameraReading> script;
  for (const double at_s : {1.0, 2.0, 3.0, 4.0, 14.0, 14.0}) {
    script.push_back(image(fmt::format("{:.0f}", at_s), at_s, {1}));
    script.back().frame.age_s = 0.1;
  }
  feed(script, 6);
  EXPECT_EQ(frames_.counts().put, 6U);
  EXPECT_EQ(stale_, 0U);
}

// The clock stands still: only the stop request can end the pause after a failure.
TEST_F(CameraFeedTest, StopsAtOnceAfterAFailure) {
  const ManualClock clock;
  std::condition_variable reported;
  bool failed = false;
  CameraFeed feed(std::make_unique<ScriptedCamera>(std::deque{failure("unplugged")}), 0, clock, frames_, watch_,
                  [&](const OnboardEvent&) {
                    const std::scoped_lock lock(mutex_);
                    failed = true;
                    reported.notify_all();
                  });
  std::unique_lock lock(mutex_);
  ASSERT_TRUE(reported.wait_for(lock, kFarTooLong, [&] { return failed; }));
}

}  // namespace
}  // namespace nadir
