#include "simulation/frame_sink.hpp"

#include <gtest/gtest.h>

#include <stdexcept>
#include <vector>

namespace nadir {
namespace {

using std::chrono::hours;
using std::chrono::milliseconds;
using std::chrono::steady_clock;

class Kept final : public FrameSink {
 public:
  void put(ByteView jpeg, std::int64_t unix_us) override {
    if (jpeg.empty()) throw std::runtime_error("no room");
    times_us.push_back(unix_us);
    at.push_back(steady_clock::now());
  }
  std::vector<std::int64_t> times_us;
  std::vector<steady_clock::time_point> at;
};

TEST(DelayedSink, HandsOnEachInItsOrderAndNotBeforeItsTime) {
  Kept kept;
  const auto now = steady_clock::now();
  {
    DelayedSink sink(kept);
    for (int i = 0; i < 8; ++i) sink.put({1}, i, now + milliseconds(20 + i));
    sink.finish();
    EXPECT_EQ(sink.delivered(), 8);
  }
  ASSERT_EQ(kept.times_us, (std::vector<std::int64_t>{0, 1, 2, 3, 4, 5, 6, 7}));
  for (int i = 0; i < 8; ++i) EXPECT_GE(kept.at[static_cast<std::size_t>(i)], now + milliseconds(20 + i));
}

// The whole point: whoever makes pictures does not wait until one is due.
TEST(DelayedSink, TakesTheNextWhileOneWaits) {
  Kept kept;
  DelayedSink sink(kept);
  for (int i = 0; i < 100; ++i) sink.put({1}, i, steady_clock::now() + hours(1));
  EXPECT_EQ(sink.delivered(), 0);
}  // and ends at once, dropping them

TEST(DelayedSink, SaysWhatTheSinkSaid) {
  Kept kept;
  DelayedSink sink(kept);
  sink.put({1}, 1, steady_clock::now());
  sink.put({}, 2, steady_clock::now());
  EXPECT_THROW(sink.finish(), std::runtime_error);
  EXPECT_THROW(sink.put({1}, 3, steady_clock::now()), std::runtime_error);
  EXPECT_EQ(sink.delivered(), 1);
  EXPECT_EQ(kept.times_us, std::vector<std::int64_t>{1});
}

TEST(DelayedSink, NothingToHandOnIsDone) {
  Kept kept;
  DelayedSink sink(kept);
  sink.finish();
  EXPECT_EQ(sink.delivered(), 0);
}

}  // namespace
}  // namespace nadir
