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

TEST(FlightBoard, ReturnsTheLatestViewWithItsNumber) {
  FlightBoard board;
  board.publish(view_at(1));
  board.publish(view_at(2));
  EXPECT_EQ(board.snapshot()->version, 2U);
  EXPECT_EQ(board.snapshot()->time_s, 2);
  EXPECT_EQ(board.snapshot(), board.snapshot()) << "the same view, not a copy of it";
}

TEST(FlightBoard, AViewInUseIsNeverModified) {
  FlightBoard board;
  board.publish(view_at(1));
  const auto held = board.snapshot();
  board.publish(view_at(2));
  EXPECT_EQ(held->time_s, 1);
  EXPECT_EQ(board.snapshot()->time_s, 2);
}

// Readers that look without pause see whole views in their order, and the last one is seen by all.
TEST(FlightBoard, ConcurrentReadersSeeConsistentViewsInOrder) {
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

TEST(EventRing, KeepsTheLatestEventsAndContinuesNumbering) {
  EventRing ring(3);
  for (int i = 1; i <= 5; ++i) ring.add(i, EventSeverity::info, "state", std::to_string(i));
  ASSERT_EQ(ring.events().size(), 3U);
  EXPECT_EQ(ring.events().front().id, 3U);
  EXPECT_EQ(ring.events().back().id, 5U);
  EXPECT_EQ(ring.events().back().text, "5");
}

TEST(FlightTrail, ThinsAndDropsOldPoints) {
  FlightTrail trail(10, 1);
  for (int i = 0; i <= 240; ++i) {
    TrackPoint point;
    point.time_s = i * 0.125;
    trail.add(point);
  }
  ASSERT_EQ(trail.points().size(), 11U);
  EXPECT_NEAR(trail.points().front().time_s, 20, 1e-9);
  EXPECT_NEAR(trail.points().back().time_s, 30, 1e-9);
  for (std::size_t i = 1; i < trail.points().size(); ++i) {
    EXPECT_GE(trail.points()[i].time_s - trail.points()[i - 1].time_s, 1 - 1e-9);
  }
}

}  // namespace
}  // namespace nadir
