#include "api/flight_view.hpp"

#include <gtest/gtest.h>

#include <atomic>
#include <thread>
#include <vector>

namespace nadir {
namespace {

FlightView view_at(double time_s) {
  FlightView view;
  view.time_s = time_s;
  view.state.reason = std::string(64, 'x');
  return view;
}

TEST(FlightBoard, ShowsABootingServiceBeforeTheFirstPublish) {
  const FlightBoard board;
  EXPECT_EQ(board.snapshot()->version, 0U);
  EXPECT_EQ(board.snapshot()->state.state, ServiceState::boot);
}

TEST(FlightBoard, ShowsTheLatestAndNumbersIt) {
  FlightBoard board;
  board.publish(view_at(1));
  board.publish(view_at(2));
  EXPECT_EQ(board.snapshot()->version, 2U);
  EXPECT_EQ(board.snapshot()->time_s, 2);
  EXPECT_EQ(board.snapshot(), board.snapshot()) << "the same view, not a copy of it";
}

TEST(FlightBoard, WhatAReaderHoldsStaysAsItWas) {
  FlightBoard board;
  board.publish(view_at(1));
  const auto held = board.snapshot();
  board.publish(view_at(2));
  EXPECT_EQ(held->time_s, 1);
  EXPECT_EQ(board.snapshot()->time_s, 2);
}

// Readers that look without pause see whole views in their order, and the last one is seen by all.
TEST(FlightBoard, ManyReadersSeeWholeViewsInOrder) {
  constexpr int kViews = 2000, kReaders = 4;
  FlightBoard board;
  std::atomic<int> broken{0};
  std::vector<std::thread> readers;
  for (int i = 0; i < kReaders; ++i) {
    readers.emplace_back([&] {
      std::uint64_t before = 0;
      while (before < kViews) {
        const auto view = board.snapshot();
        if (view->version < before) ++broken;
        if (view->version != 0 && view->time_s != static_cast<double>(view->version)) ++broken;
        before = view->version;
        std::this_thread::yield();
      }
    });
  }
  for (int i = 1; i <= kViews; ++i) board.publish(view_at(i));
  for (std::thread& reader : readers) reader.join();
  EXPECT_EQ(broken, 0);
}

TEST(Mailbox, TheLatestIsTakenOnce) {
  Mailbox<int> box;
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
