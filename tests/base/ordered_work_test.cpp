#include "base/ordered_work.hpp"

#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <numeric>
#include <stdexcept>

namespace nadir {
namespace {

std::function<int(std::size_t)> uneven_worker() {
  return [](std::size_t item) {
    std::this_thread::sleep_for(std::chrono::microseconds((item * 7919) % 500));
    return static_cast<int>(item);
  };
}

TEST(OrderedWork, ReturnsResultsInOrderForAnyNumberOfThreads) {
  for (const int threads : {1, 2, 7}) {
    std::vector<int> taken;
    work_in_order<int>(100, threads, uneven_worker, [&](std::size_t, int value) {
      taken.push_back(value);
      return true;
    });
    std::vector<int> expected(100);
    std::iota(expected.begin(), expected.end(), 0);
    EXPECT_EQ(taken, expected);
  }
}

TEST(OrderedWork, StopsOnRequest) {
  int taken = 0;
  std::atomic<int> worked = 0;
  work_in_order<int>(
      10'000, 3, [&] { return std::function<int(std::size_t)>([&](std::size_t) { return ++worked; }); },
      [&](std::size_t, int) { return ++taken < 10; });
  EXPECT_EQ(taken, 10);
  EXPECT_LT(worked, 30);  // no thread runs far ahead
}

TEST(OrderedWork, PropagatesErrorsFromEveryStage) {
  const auto fine = [](std::size_t, int) { return true; };
  const auto failing_start = []() -> std::function<int(std::size_t)> { throw std::runtime_error("start"); };
  EXPECT_THROW(work_in_order<int>(5, 2, failing_start, fine), std::runtime_error);
  const auto failing_work = [] {
    return std::function<int(std::size_t)>([](std::size_t item) -> int {
      if (item == 3) throw std::runtime_error("work");
      return 0;
    });
  };
  EXPECT_THROW(work_in_order<int>(50, 2, failing_work, fine), std::runtime_error);
  EXPECT_THROW(
      work_in_order<int>(50, 2, uneven_worker, [](std::size_t, int) -> bool { throw std::logic_error("take"); }),
      std::logic_error);
}

TEST(OrderedWork, AcceptsNoWork) {
  work_in_order<int>(0, 4, uneven_worker, [](std::size_t, int) { return true; });
}

}  // namespace
}  // namespace nadir
