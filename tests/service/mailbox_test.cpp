#include "service/mailbox.hpp"

#include <gtest/gtest.h>

#include <memory>
#include <thread>
#include <vector>

namespace nadir {
namespace {

TEST(LatestMailbox, TheLatestWins) {
  LatestMailbox<int> box;
  for (int i = 1; i <= 10; ++i) box.put(i);
  EXPECT_EQ(box.try_take(), 10);
  EXPECT_EQ(box.try_take(), std::nullopt);
  EXPECT_EQ(box.counts().put, 10);
  EXPECT_EQ(box.counts().taken, 1);
  EXPECT_EQ(box.counts().dropped, 9);
}

TEST(LatestMailbox, KeepsOrderUpToItsCapacity) {
  LatestMailbox<int> box(3);
  for (int i = 1; i <= 5; ++i) box.put(i);
  EXPECT_EQ(box.try_take(), 3);
  EXPECT_EQ(box.try_take(), 4);
  EXPECT_EQ(box.try_take(), 5);
}

TEST(LatestMailbox, CapacityZeroIsOne) {
  LatestMailbox<int> box(0);
  box.put(1);
  EXPECT_EQ(box.try_take(), 1);
}

TEST(LatestMailbox, TransfersMoveOnlyItems) {
  LatestMailbox<std::unique_ptr<int>> box;
  box.put(std::make_unique<int>(7));
  EXPECT_EQ(**box.try_take(), 7);
}

TEST(LatestMailbox, StopEndsTheWait) {
  LatestMailbox<int> box;
  std::optional<int> got = 1;
  std::jthread reader([&](std::stop_token stop) { got = box.take(stop); });
  reader.request_stop();
  reader.join();
  EXPECT_EQ(got, std::nullopt);
}

TEST(LatestMailbox, TheWaitTimesOut) {
  LatestMailbox<int> box;
  EXPECT_EQ(box.take_within(std::chrono::milliseconds(1), {}), std::nullopt);
  box.put(4);
  EXPECT_EQ(box.take_within(std::chrono::hours(1), {}), 4);
}

TEST(LatestMailbox, ClosingLetsTheReaderFinish) {
  LatestMailbox<int> box(10);
  box.put(1);
  box.put(2);
  std::vector<int> got;
  std::jthread reader([&](std::stop_token stop) {
    while (auto item = box.take(stop)) got.push_back(*item);
  });
  box.close();
  reader.join();
  EXPECT_EQ(got, (std::vector{1, 2}));
  EXPECT_TRUE(box.finished());
  box.put(3);
  EXPECT_EQ(box.try_take(), std::nullopt);
  EXPECT_EQ(box.counts().put, 2);
}

// Several writers, one reader: order is kept, nothing is lost uncounted, and the last one always arrives.
TEST(LatestMailbox, ManyWritersNeverWaitAndEveryItemIsCounted) {
  LatestMailbox<int> box(4);
  constexpr int kWriters = 3, kEach = 5000;
  std::vector<int> last(kWriters, -1);
  std::uint64_t got = 0;
  bool in_order = true;
  std::jthread reader([&](std::stop_token stop) {
    while (auto item = box.take(stop)) {
      const auto writer = static_cast<std::size_t>(*item / kEach);
      in_order = in_order && *item > last[writer];
      last[writer] = *item;
      ++got;
    }
  });
  {
    std::vector<std::jthread> writers;
    for (int w = 0; w < kWriters; ++w) {
      writers.emplace_back([&box, w] {
        for (int i = 0; i < kEach; ++i) box.put(w * kEach + i);
      });
    }
  }
  box.close();
  reader.join();
  EXPECT_TRUE(in_order);
  const MailboxCounts counts = box.counts();
  EXPECT_EQ(counts.put, kWriters * kEach);
  EXPECT_EQ(counts.taken, got);
  EXPECT_EQ(counts.taken + counts.dropped, counts.put);
}

TEST(LatestSlot, ReturnsTheLatestValueOnce) {
  LatestSlot<int> box;
  EXPECT_EQ(box.take(), nullptr);
  box.put(1);
  box.put(2);
  const auto taken = box.take();
  ASSERT_NE(taken, nullptr);
  EXPECT_EQ(*taken, 2);
  EXPECT_EQ(box.take(), nullptr);
}

}  // namespace
}  // namespace nadir
