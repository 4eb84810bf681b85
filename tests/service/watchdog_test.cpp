#include "service/watchdog.hpp"

#include <gtest/gtest.h>

#include <optional>
#include <thread>
#include <vector>

#include "support/manual_clock.hpp"
#include "service/notify_socket.hpp"

namespace nadir {
namespace {

using test::NotifySocket;

TEST(ThreadWatch, NamesWhoIsLateAndForHowLong) {
  ManualClock clock;
  ThreadWatch watch(clock);
  auto localizer = watch.watch("localizer", 2);
  auto recorder = watch.watch("recorder", 10);
  clock.advance(2);
  EXPECT_TRUE(watch.late().empty());
  clock.advance(0.5);
  ASSERT_EQ(watch.late().size(), 1);
  EXPECT_EQ(watch.late()[0].name, "localizer");
  EXPECT_EQ(watch.late()[0].text(), "localizer silent for 2.5 s (at most 2 s)");
  localizer();
  EXPECT_TRUE(watch.late().empty());
  clock.advance(20);
  EXPECT_EQ(watch.late().size(), 2);
}

TEST(ThreadWatch, AThreadThatEndedInOrderIsNotLate) {
  ManualClock clock;
  ThreadWatch watch(clock);
  std::optional<ThreadWatch::Beat> beat(watch.watch("api", 1));
  clock.advance(5);
  EXPECT_EQ(watch.late().size(), 1);
  beat.reset();
  EXPECT_TRUE(watch.late().empty());
}

TEST(ThreadWatch, BeatsComeFromManyThreads) {
  ManualClock clock;
  ThreadWatch watch(clock);
  std::vector<std::jthread> threads;
  for (int i = 0; i < 4; ++i) {
    threads.emplace_back([beat = watch.watch("worker", 1)]() mutable {
      for (int n = 0; n < 2000; ++n) beat();
    });
  }
  for (int n = 0; n < 200; ++n) {
    clock.advance(0.001);
    watch.late();
  }
  threads.clear();
  EXPECT_TRUE(watch.late().empty());
}

TEST(Watchdog, IsFedOnlyWhileEverybodyLives) {
  const NotifySocket systemd;
  const ServiceManager manager(systemd.address());
  ManualClock clock;
  ThreadWatch watch(clock);
  auto beat = watch.watch("localizer", 2);
  Watchdog watchdog(watch, manager, 3, clock.monotonic_s());

  EXPECT_EQ(watchdog.tick(clock.monotonic_s()), std::nullopt);
  EXPECT_EQ(systemd.received(), "WATCHDOG=1");
  for (int i = 0; i < 9; ++i) {
    clock.advance(0.1);
    beat();
    watchdog.tick(clock.monotonic_s());
  }
  EXPECT_EQ(systemd.received(), std::nullopt) << "a third of the interval has not passed";
  clock.advance(0.2);
  beat();
  watchdog.tick(clock.monotonic_s());
  EXPECT_EQ(systemd.received(), "WATCHDOG=1");

  clock.advance(2.5);
  EXPECT_EQ(watchdog.tick(clock.monotonic_s()), "localizer silent for 2.5 s (at most 2 s)");
  EXPECT_EQ(systemd.received(), "STATUS=hangs: localizer silent for 2.5 s (at most 2 s)");
  clock.advance(5);
  EXPECT_EQ(watchdog.tick(clock.monotonic_s()), std::nullopt) << "told once";
  EXPECT_EQ(systemd.received(), std::nullopt) << "systemd will act";

  beat();
  EXPECT_EQ(watchdog.tick(clock.monotonic_s()), "");
  EXPECT_EQ(systemd.received(), "WATCHDOG=1");
}

TEST(Watchdog, WithoutSystemdItStillNamesTheLate) {
  const ServiceManager nobody(std::nullopt);
  ManualClock clock;
  ThreadWatch watch(clock);
  auto beat = watch.watch("camera", 1);
  Watchdog watchdog(watch, nobody, std::nullopt, clock.monotonic_s());
  clock.advance(2);
  EXPECT_EQ(watchdog.tick(clock.monotonic_s()), "camera silent for 2.0 s (at most 1 s)");
}

}  // namespace
}  // namespace nadir
