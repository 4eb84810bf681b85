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

// Readers that poll without pause see complete views in order, and all of them see the last one.
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

// Short gaps of the camera, five times: two lines, not ten, and nothing else displaced.
TEST(EventRing, RepeatsTakeThePlaceOfTheirLastOccurrenceAndCount) {
  EventRing ring(3, 300);
  ring.add(1, EventSeverity::critical, "gps", "GPS is spoofed");
  for (int i = 0; i < 5; ++i) {
    ring.add(10 + i, EventSeverity::warning, "state", "no frame for 0." + std::to_string(41 + i) + " s");
    ring.add(10.5 + i, EventSeverity::info, "state", "visual position restored");
  }
  ASSERT_EQ(ring.events().size(), 3U);
  EXPECT_EQ(ring.events()[0].text, "GPS is spoofed");
  EXPECT_EQ(ring.events()[0].count, 1U);
  EXPECT_EQ(ring.events()[1].text, "no frame for 0.45 s") << "the latest";
  EXPECT_EQ(ring.events()[1].count, 5U);
  EXPECT_EQ(ring.events()[1].id, 10U);
  EXPECT_EQ(ring.events()[1].replaces, 8U);
  EXPECT_EQ(ring.gone(), 0U) << "nothing was displaced";
  ring.add(1000, EventSeverity::warning, "state", "no frame for 0.5 s");
  EXPECT_EQ(ring.events().back().count, 1U) << "a different event by now";
  EXPECT_EQ(ring.gone(), 1U);
}

TEST(EventRing, AnotherSeverityOrKindIsNoRepeat) {
  EventRing ring(10, 300);
  ring.add(1, EventSeverity::warning, "state", "x");
  ring.add(2, EventSeverity::critical, "state", "x");
  ring.add(3, EventSeverity::warning, "link", "x");
  EXPECT_EQ(ring.events().size(), 3U);
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
