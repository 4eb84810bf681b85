#include "http/fair_queue.hpp"

#include <gtest/gtest.h>

#include <future>
#include <semaphore>

namespace nadir {
namespace {

TEST(FairQueue, ServesLanesInTurn) {
  std::promise<void> go, done;  // before the queue, as all that its threads touch: they end with it
  std::string order;
  FairQueue queue(1, 100);
  queue.put("block", [&] { go.get_future().wait(); });
  for (int i = 0; i < 5; ++i) queue.put("greedy", [&] { order += 'g'; });
  queue.put("modest", [&] { order += 'm'; });
  queue.put("last", [&] { order += 'l'; });
  queue.put("greedy", [&] { done.set_value(); });
  go.set_value();
  done.get_future().wait();
  queue.stop();
  EXPECT_EQ(order, "gmlgggg");
}

TEST(FairQueue, AFullLaneDoesNotBlockOthers) {
  std::promise<void> go, begun;
  FairQueue queue(1, 2);
  queue.put("greedy", [&] { begun.set_value(), go.get_future().wait(); });
  begun.get_future().wait();
  EXPECT_TRUE(queue.put("greedy", [] {}));
  EXPECT_TRUE(queue.put("greedy", [] {}));
  EXPECT_FALSE(queue.put("greedy", [] {}));
  EXPECT_TRUE(queue.put("other", [] {}));
  go.set_value();
}

TEST(FairQueue, ALaneNeverOccupiesAllThreads) {
  std::counting_semaphore<> go(0);
  std::promise<void> done;
  FairQueue queue(2, 100);
  for (int i = 0; i < 10; ++i) queue.put("greedy", [&] { go.acquire(); });
  queue.put("modest", [&] { done.set_value(); });
  done.get_future().wait();  // although the greedy one's work never ends
  go.release(10);
}

TEST(FairQueue, DropsWaitingWorkAtTheEnd) {
  std::promise<void> go, begun;
  bool ran = false;
  FairQueue queue(1, 10'000'000);  // never full, so that a refusal means the end
  queue.put("a", [&] { begun.set_value(), go.get_future().wait(); });
  queue.put("a", [&] { ran = true; });
  begun.get_future().wait();
  std::thread stopper([&] { queue.stop(); });
  while (queue.put("a", [] {})) std::this_thread::yield();  // until it is stopping
  go.set_value();
  stopper.join();
  EXPECT_FALSE(queue.put("a", [] {}));
  EXPECT_FALSE(ran);
}

}  // namespace
}  // namespace nadir
